"""``tactile``: the main command. Each subcommand is a module that is imported only when it is chosen.

The module of a subcommand has `add_arguments(parser)` and `run(arguments) -> int`, or subcommands of its own that set
`action` instead, and may have `DESCRIPTION` and `EPILOG`. ``tactile --help`` and completion need only the table below,
so both are fast.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactile_nodes import __version__
from tactile_nodes.errors import TactileError

VERBS = {
    'launch': 'run a launch file: start its nodes, monitor them, stop them',
    'run': 'run one node',
    'view': 'watch force, latency and the state of the nodes in this terminal',
    'topic': 'list, print, measure and publish topics',
    'node': 'list nodes, show what one offers and whether it responds',
    'param': "list, read, change, save and load the nodes' parameters",
    'service': 'list and call services',
    'bag': 'record topics, play recordings, show their contents',
    'dataset': 'build a training set from bags, or from pictures and a table',
    'export': 'convert bags to parquet, zarr or a LeRobot data set for robot learning',
    'collect': 'inspect a plan of presses before a rig runs it',
    'camera': 'list the cameras, each with the source that finds it again',
    'sensor': 'describe a sensor from its pictures, and check pictures against a description',
    'press': 'collect presses by hand with a ball and a scale, guided step by step',
    'train': 'make a force model from simulated or recorded presses',
    'calibrate': 'transfer a model to another gel with a few presses',
    'gels': 'list the calibrations of this lab, and which of them is due',
    'tune': 'find the smallest configuration that is accurate or fast enough',
    'evaluate': 'score a force model on presses that were not used for training',
    'model': "show a trained model's card, or export the model as ONNX",
    'bench': 'measure this machine with the benchmarks that the documentation quotes',
    'keys': 'create and show the keys with which machines authenticate each other',
    'compile': 'compile the inner loops before the first start of a sensor',
    'doctor': 'check this machine and suggest fixes',
    'reference': 'update the parts of the documentation that are generated from the code',
    'completion': 'print the code with which a shell completes this command',
}
INTERRUPTED = 130  # exit status that a shell reports for a program ended by Ctrl-C: 128 + SIGINT
PIPE_CLOSED = 141  # the same for SIGPIPE

EPILOG = """\
first steps:
  tactile launch live                    a simulated sensor and its force estimate; needs no hardware
  tactile view                           show it, in another terminal
  tactile topic echo /force_distribution --field total
  tactile <verb> --help                  help for a command, with examples
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tactile`` with these arguments; returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault('TACTILE_BUS', 'zeromq')  # nodes started by this command join the bus that it reads
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:  # the caller has closed it, as with >&-
            setattr(sys, name, Path(os.devnull).open(mode, encoding='utf-8'))  # noqa: SIM115
    for stream in (sys.stdin, sys.stdout):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in {'strict', 'surrogateescape'}:
            stream.reconfigure(errors='backslashreplace')  # as stderr has it: a terminal may lack a letter
    try:
        status = _run(words)
        sys.stdout.flush()
    except TactileError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (for example `head`); what is still buffered cannot be written either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED
    except OSError as error:
        said = f'{error.filename!r}: {error.strerror}' if error.filename else error.strerror or error
        print(f'operating system error: {said}; check disk space and permissions', file=sys.stderr)
        return 1
    return status


def _run(words: Sequence[str]) -> int:
    verb = chosen_verb(words)
    parser = make_parser(verb)
    _complete(parser)
    arguments = parse(parser, verb, words)
    if arguments.verb is None:
        parser.print_help()
        return 0
    run = getattr(_module(arguments.verb), 'run', None) or arguments.action  # of its own, or of a subcommand
    status: int = run(arguments)
    return status


def make_parser(verb: str | None) -> argparse.ArgumentParser:
    """The parser; only `verb` gets its own arguments, the other subcommands are listed by name."""
    parser = argparse.ArgumentParser(
        prog='tactile',
        description='Vision-based touch sensing: nodes, topics, recordings and models.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'tactile_nodes {__version__}')
    verbs = parser.add_subparsers(dest='verb', metavar='verb', title='verbs')
    for name, line in VERBS.items():
        module = _module(name) if name == verb else None
        command = verbs.add_parser(
            name,
            help=line,
            description=getattr(module, 'DESCRIPTION', None) or f'{line[0].upper()}{line[1:]}.',
            epilog=getattr(module, 'EPILOG', None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if module is not None:
            module.add_arguments(command)
            _complete_help(command, f'tactile {name}')
    return parser


def _complete_help(parser: argparse.ArgumentParser, words: str) -> None:
    """Give the subcommands of a subcommand their line as description, and those of its examples that are theirs."""
    written = (parser.epilog or '').splitlines()
    commands = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for name, line in [(each.dest, each.help or '') for found in commands for each in found._choices_actions]:
        command = commands[0].choices[name]
        command.description = command.description or f'{line[0].upper()}{line[1:]}.'
        own = [line for line in written if line.strip().startswith(f'{words} {name}')]
        if own and not command.epilog:
            command.epilog = '\n'.join(['examples:', *own])
            command.formatter_class = argparse.RawDescriptionHelpFormatter


def parse(parser: argparse.ArgumentParser, verb: str | None, words: Sequence[str]) -> argparse.Namespace:
    """Parse `words`; flags may stand between the other arguments, as in ``launch live --view source:=…``."""
    if verb is None or _keeps_order(own := _parser_of(parser, verb)):
        return parser.parse_args(words)
    place = list(words).index(verb)
    arguments = parser.parse_args(words[:place])
    arguments.verb = verb
    return own.parse_intermixed_args(words[place + 1 :], arguments)


def _parser_of(parser: argparse.ArgumentParser, verb: str) -> argparse.ArgumentParser:
    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    found: argparse.ArgumentParser = verbs.choices[verb]
    return found


def _keeps_order(parser: argparse.ArgumentParser) -> bool:
    """Whether a parser has subcommands or passes the rest of its line on, so that the order matters."""
    return any(action.nargs in {argparse.PARSER, argparse.REMAINDER} for action in parser._actions)


def chosen_verb(words: Sequence[str]) -> str | None:
    """The subcommand in `words`, or in the line that a shell asks to complete."""
    if '_ARGCOMPLETE' in os.environ:
        words = os.environ.get('COMP_LINE', '').split()[1:]
    return next((word for word in words if word in VERBS), None)


def _complete(parser: argparse.ArgumentParser) -> None:
    """If a shell asks for completions, print them and exit."""
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser, always_complete_options=False)


def _module(verb: str) -> Any:
    return importlib.import_module(f'tactile_nodes.cli.{verb}')


if __name__ == '__main__':
    sys.exit(main())
