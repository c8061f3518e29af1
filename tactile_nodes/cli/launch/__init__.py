"""`tactile launch`: run a launch file, with the arguments and flags of ``ros2 launch``."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactile_nodes.bus.node.signals import handling, that_end
from tactile_nodes.errors import ConfigurationError, TactileError
from tactile_nodes.launching import description, files, packages
from tactile_nodes.launching.document import suggestion
from tactile_nodes.launching.processes.output import Screen, print_line
from tactile_nodes.launching.service import LaunchService

DESCRIPTION = 'Run a launch file: start its nodes, monitor them and stop them together.'
EPILOG = """\
examples:
  tactile launch live                                 the live view of the simulated sensor
  tactile launch live --view                          the same, shown in this terminal; output goes to the log
  tactile launch live --show-args                     list its arguments
  tactile launch live source:=/dev/video0             the same with a camera
  tactile launch tactile_nodes live.launch.yaml       the syntax of ros2 launch
  tactile launch ./my.launch.yaml rate:=60            a file of yours

The exit status is 1 if the file has an error, if a required process (on_exit: shutdown) failed, or if a process could
not be started.
"""
# Launch configurations that the launcher itself reads. No file needs to declare them.
_BUILT_IN = {
    'emulate_tty',
    'launch-prefix',
    'launch-prefix-filter',
    'ros_namespace',
    'sigkill_timeout',
    'sigterm_timeout',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.usage = '%(prog)s [-h] [-s | -p] [-d] [-n] [-a] [PKG] FILE [name:=value ...]'
    words = parser.add_argument(
        'words',
        nargs='+',
        metavar='FILE',
        help='a launch file by path, by package and name, or by name alone; then its arguments',
    )
    words.completer = complete  # type: ignore[attr-defined]
    show = parser.add_mutually_exclusive_group()
    show.add_argument('-s', '--show-args', '--show-arguments', action='store_true', help='list its arguments')
    show.add_argument(
        '-p', '--print', '--print-description', action='store_true', help='print the launch description; run nothing'
    )
    parser.add_argument('--view', action='store_true', help='watch force, latency and the nodes in this terminal')
    parser.add_argument('-d', '--debug', action='store_true', help='log each command in full')
    parser.add_argument('-n', '--noninteractive', action='store_true', help='run without an interactive terminal')
    parser.add_argument(
        '-a',
        '--show-all-subprocesses-output',
        action='store_true',
        help='show all output of all processes, whatever the file says',
    )


def run(arguments: argparse.Namespace) -> int:
    file, words = files.resolve(arguments.words, os.environ)
    if arguments.show_args:
        print(description.arguments_text(file))
        return 0
    if arguments.print:
        print(description.file_text(file))
        return 0
    given = files.parse_arguments(words)
    if arguments.view:
        return _run_with_view(arguments, file, given)
    service = make_service(arguments, file, given)
    with signals_to(service):
        return service.run()


def _run_with_view(arguments: argparse.Namespace, file: Path, given: dict[str, str]) -> int:
    from tactile_nodes.cli.launch import view as launch_view

    notes = launch_view.Notes()
    service = make_service(arguments, file, given, screen=notes)
    with signals_to(service):
        return launch_view.run(service, notes, given.get('namespace', ''))


def make_service(
    arguments: argparse.Namespace, file: Path, given: dict[str, str], screen: Screen = print_line
) -> LaunchService:
    refuse_unknown(file, given)
    return LaunchService(
        file,
        given,
        screen=screen,
        output='both' if arguments.show_all_subprocesses_output or arguments.view else None,
        interactive=sys.stdin.isatty() and not arguments.noninteractive,
        debug=arguments.debug,
    )


def refuse_unknown(file: Path, given: dict[str, str]) -> None:
    """Refuse undeclared arguments, which are probably misspelled. ROS 2 ignores them silently.

    Raises:
        ConfigurationError: an argument is not declared; the message suggests the nearest name.
    """
    declared = {each.argument.name for each in description.declared_arguments(file, given)}
    if unknown := sorted(given.keys() - declared - _BUILT_IN):
        name = unknown[0]
        raise ConfigurationError(
            f"{file.name} has no argument '{name}'{suggestion(name, declared)} (--show-args lists them all)"
        )


@contextmanager
def signals_to(service: LaunchService) -> Iterator[None]:
    """Shut down the launch on Ctrl-C, SIGTERM or, unless it was started by ``nohup``, when the terminal closes."""

    def end(number: signal.Signals) -> None:
        if number == signal.SIGINT:
            service.interrupt()
        else:
            service.shutdown(f'{number.name} received')

    with handling(that_end(), end):
        yield


def complete(prefix: str, parsed_args: argparse.Namespace, **_: object) -> list[str]:
    """Names of launch files and packages; after the file, its arguments."""
    words = parsed_args.words or []
    try:
        if not words:
            return [*files.own_names(), *packages.package_names(os.environ), *_launch_files(prefix)]
        file, _words = files.resolve(words, os.environ)
        return [f'{each.argument.name}:=' for each in description.declared_arguments(file)]
    except TactileError:
        return []


def _launch_files(prefix: str) -> list[str]:
    folder = Path(prefix).parent if prefix else Path()
    return [str(file) for file in folder.glob('*.launch.y*ml')] if folder.is_dir() else []
