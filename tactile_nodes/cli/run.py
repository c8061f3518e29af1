"""`tactile run`: run one executable, with the arguments and flags of ``ros2 run``."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Sequence

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.launching import packages
from tactile_nodes.launching.template import SubstitutionError

DESCRIPTION = 'Run an executable of a package.'
EPILOG = """\
examples:
  tactile run camera_node                                        a node of this package
  tactile run camera_node --ros-args -r __ns:=/left -p fps:=30.0
  tactile run tactile_nodes camera_node --ros-args --params-file camera.yaml
  tactile run --prefix 'taskset -c 1' camera_node                with a command in front
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.usage = '%(prog)s [-h] [--prefix COMMAND] [PKG] EXEC [argument ...]'
    parser.add_argument(
        '--prefix',
        metavar='COMMAND',
        help="a command to put before it, in quotes if it has spaces: 'gdb -ex run --args'",
    )
    words = parser.add_argument(
        'words', nargs=argparse.REMAINDER, metavar='EXEC', help='the executable and its arguments'
    )
    words.completer = complete  # type: ignore[attr-defined]


def run(arguments: argparse.Namespace) -> int:
    """Replace this process by the executable, so that signals and the exit status are its own."""
    package, executable, words = split(arguments.words)
    try:
        program = packages.command_of(package, executable, os.environ)
    except SubstitutionError as error:
        raise ConfigurationError(str(error)) from error
    command = [*_words_of(arguments.prefix or ''), *program, *words]
    try:
        os.execvpe(command[0], command, {**os.environ, **packages.source_environment(program)})  # noqa: S606
    except OSError as error:
        raise ConfigurationError(f'cannot run {command[0]}: {error.strerror}') from error


def _words_of(prefix: str) -> list[str]:
    try:
        return shlex.split(prefix)
    except ValueError as error:
        raise ConfigurationError(f'--prefix {prefix!r} is not a command: {error}; check its quotes') from error


def split(words: Sequence[str]) -> tuple[str, str, list[str]]:
    """Package, executable and arguments of ``[PKG] EXEC …``.

    Raises:
        ConfigurationError: no executable is named; the message lists the available ones.
    """
    package_names = packages.package_names(os.environ)
    package = words[0] if words and words[0] in package_names else packages.OWN
    rest = list(words[1:] if words and words[0] in package_names else words)
    if not rest:
        names = ', '.join(packages.executables_of(package, os.environ))
        raise ConfigurationError(f"name an executable of package '{package}'; available: {names or 'none'}")
    return package, rest[0], rest[1:]


def complete(prefix: str, parsed_args: argparse.Namespace, **_: object) -> list[str]:
    """Names of packages and executables."""
    words = parsed_args.words or []
    package = words[0] if words else packages.OWN
    names = packages.executables_of(package, os.environ) if package in packages.package_names(os.environ) else []
    return [name for name in [*packages.package_names(os.environ), *names] if name.startswith(prefix)]
