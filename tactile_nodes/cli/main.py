"""``tactile``: the one command. Each verb is a module of its own, imported only when it is the one chosen.

A verb's module has `add_arguments(parser)` and `run(arguments) -> int`, and may have `DESCRIPTION` and `EPILOG`. Its
line in the table below is all that ``tactile --help`` and the completion of verbs need, so both answer at once.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from tactile_nodes import __version__
from tactile_nodes.errors import TactileError

VERBS = {
    'launch': 'run a launch file: start its nodes, watch them, end them',
    'run': 'run one node',
    'view': 'watch force, latency and the state of the nodes in this terminal',
    'topic': 'list, print, measure and publish topics',
    'node': 'list nodes; what one offers, and whether it answers',
    'param': "list, read, change, save and load the nodes' parameters",
    'service': 'list and call services',
    'bag': 'record topics, play recordings, say what is in them',
    'dataset': 'make a training set of bags, or of pictures and a table; say what one holds',
    'export': 'turn bags into parquet, zarr or a LeRobot data set for robot learning',
    'collect': 'look at a plan of presses before a rig does it',
    'camera': 'list the cameras, and by which source each is found again',
    'sensor': 'describe a sensor from its pictures, and judge pictures beside its description',
    'press': 'press by hand with a ball and a scale, and be told where, how hard, and when it is enough',
    'train': 'make a force model from simulated or recorded presses',
    'calibrate': 'transfer a model to another gel by a few presses',
    'gels': 'list the calibrations of this lab, and which of them is due',
    'tune': 'find the smallest configuration that is good or fast enough',
    'evaluate': 'score a force model on presses that it never saw',
    'model': 'take a trained model elsewhere: export it as ONNX',
    'bench': 'measure this machine with the benchmarks that the documentation quotes',
    'keys': 'make and show the keys by which machines know each other',
    'compile': 'compile the inner loops ahead of the first start of a sensor',
    'doctor': 'say what this machine lacks, and what to do about it',
    'reference': 'renew the parts of the documentation that are made from the code',
    'completion': 'print what a shell needs to complete this command',
}
INTERRUPTED = 130  # what a shell reports of a program that Ctrl-C ended: 128 + SIGINT
PIPE_CLOSED = 141  # the same for SIGPIPE

EPILOG = """\
first steps:
  tactile launch live                    a simulated sensor, its force estimate, and nothing to plug in
  tactile view                           see it, from another terminal
  tactile topic echo /force_distribution --field total
  tactile <verb> --help                  more of each, with examples
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tactile`` with these words; the result is the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault('TACTILE_BUS', 'zeromq')  # nodes started by this command join the bus that it looks at
    try:
        status = _run(words)
        sys.stdout.flush()
    except TactileError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has gone, say `head`; what is still buffered has nowhere to go either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED
    except OSError as error:
        print(_refused(error), file=sys.stderr)
        return 1
    return status


def _refused(error: OSError) -> str:
    """What the system would not do (a full disk, a name that is too long), in one sentence."""
    name = f'{error.filename!r}: ' if error.filename else ''
    return f'the system refused: {name}{error.strerror or error}; look at space and permissions'


def _run(words: Sequence[str]) -> int:
    verb = chosen_verb(words)
    parser = make_parser(verb)
    _complete(parser)
    arguments = parse(parser, verb, words)
    if arguments.verb is None:
        parser.print_help()
        return 0
    status: int = _module(arguments.verb).run(arguments)
    return status


def make_parser(verb: str | None) -> argparse.ArgumentParser:
    """The parser; only `verb` brings its own arguments, the others stand there by name."""
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
        made = verbs.add_parser(
            name,
            help=line,
            description=getattr(module, 'DESCRIPTION', None) or f'{line[0].upper()}{line[1:]}.',
            epilog=getattr(module, 'EPILOG', None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if module is not None:
            module.add_arguments(made)
            _give_examples(made, f'tactile {name}')
    return parser


def _give_examples(parser: argparse.ArgumentParser, words: str) -> None:
    """Show those examples of a verb that are of one of its commands in the help of that command too."""
    written = (parser.epilog or '').splitlines()
    commands = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    for name, command in [pair for found in commands for pair in found.items()]:
        own = [line for line in written if line.strip().startswith(f'{words} {name}')]
        if own and not command.epilog:
            command.epilog = '\n'.join(['examples:', *own])
            command.formatter_class = argparse.RawDescriptionHelpFormatter


def parse(parser: argparse.ArgumentParser, verb: str | None, words: Sequence[str]) -> argparse.Namespace:
    """Parse `words`; flags may stand anywhere between the other words, as in ``launch live --view source:=…``."""
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
    """Whether a parser has verbs of its own or hands on the rest of its line, where order means something."""
    return any(action.nargs in {argparse.PARSER, argparse.REMAINDER} for action in parser._actions)


def chosen_verb(words: Sequence[str]) -> str | None:
    """The verb among `words`, or the one on the line that a shell asks us to complete."""
    if '_ARGCOMPLETE' in os.environ:
        words = os.environ.get('COMP_LINE', '').split()[1:]
    return next((word for word in words if word in VERBS), None)


def _complete(parser: argparse.ArgumentParser) -> None:
    """If it is a shell that asks, answer and end here."""
    if '_ARGCOMPLETE' in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser, always_complete_options=False)


def _module(verb: str) -> Any:
    return importlib.import_module(f'tactile_nodes.cli.{verb}')


if __name__ == '__main__':
    sys.exit(main())
