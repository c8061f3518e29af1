"""The parts of the documentation that are generated from the command line."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from reference.pages import code, table
from tactile_nodes.cli import main


def verbs() -> str:
    """A table of all commands and their subcommands."""
    rows = [[code(verb), ' '.join(map(code, _words(_parser(verb)))), line] for verb, line in main.VERBS.items()]
    return table(['command', 'subcommands', 'description'], rows)


def flags() -> str:
    """The arguments of every command."""
    return '\n\n'.join(_section(words, parser) for verb in main.VERBS for words, parser in commands(verb))


def _parser(verb: str) -> argparse.ArgumentParser:
    return _choices(main.make_parser(verb))[verb]


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    found = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(found[0].choices) if found else {}


def _words(parser: argparse.ArgumentParser) -> list[str]:
    return list(_choices(parser))


def commands(verb: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """A command, or each of its subcommands: the words after ``tactile``, and the parser."""
    own = _parser(verb)
    below = _choices(own)
    if not below:
        yield verb, own
    for word, parser in below.items():
        yield f'{verb} {word}', parser


def _section(words: str, parser: argparse.ArgumentParser) -> str:
    actions = [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]
    title = f'### `tactile {words}`\n\n{_first(parser.description)}'
    rows = [_row(parser, action) for action in actions if action.help is not argparse.SUPPRESS]
    return f'{title}\n\n{table(["argument", "description"], rows)}' if rows else title


def _first(text: str | None) -> str:
    """The first paragraph, in one line."""
    return ' '.join((text or '').strip().partition('\n\n')[0].split())


def _row(parser: argparse.ArgumentParser, action: argparse.Action) -> list[str]:
    formatter = parser._get_formatter()
    value = formatter._format_args(action, _metavar(action)) if action.nargs != 0 else ''
    names = ', '.join(code(name) for name in action.option_strings)
    told = formatter._expand_help(action) if action.help else ''
    return [f'{names} {code(value)}'.strip(), ' '.join(told.split())]


def _metavar(action: argparse.Action) -> str:
    return str(action.dest).upper() if action.option_strings else str(action.dest)
