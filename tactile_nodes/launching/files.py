"""Find a launch file: by path, by package and name, or, for files of this package, by name alone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.errors import LaunchFileError
from tactile_nodes.launching import packages
from tactile_nodes.launching.document import SUFFIXES, suggestion


def own_names() -> list[str]:
    """The names of this package's launch files, without ending: ``live``, ``collect``, …"""
    return sorted(_own_files())


def resolve(words: Sequence[str], environment: Mapping[str, str]) -> tuple[Path, list[str]]:
    """The launch file named by the arguments of a command line, and the remaining arguments.

    ``[PKG] FILE [name:=value …]`` as for ``ros2 launch``, where FILE may be anywhere below the package's share
    folder; or only the name of a launch file of this package.

    Raises:
        LaunchFileError: no such file.
    """
    first, *rest = words
    if rest and ':=' not in rest[0] and first in packages.package_names(environment):
        return _in_package(first, rest[0], environment), rest[1:]
    if Path(first).is_file():
        return Path(first), rest
    if first in (own := _own_files()):
        return own[first], rest
    if rest and ':=' not in rest[0]:
        package_names = packages.package_names(environment)
        raise LaunchFileError(f"package '{first}' not found{suggestion(first, package_names)}")
    raise LaunchFileError(f"no launch file '{first}'{suggestion(first, own)}")


def parse_arguments(words: Sequence[str]) -> dict[str, str]:
    """``name:=value`` arguments as a mapping; the last of several wins. Shells leave a ``~/`` after ``:=`` as it is.

    Raises:
        LaunchFileError: an argument of another form.
    """
    arguments: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(':=')
        if not name or not separator or (not value and word.count(':=') == 1):
            raise LaunchFileError(f"malformed launch argument '{word}', expected format '<name>:=<value>'")
        arguments[name] = f'{Path.home()}{value[1:]}' if value.startswith('~/') else value
    return arguments


def _in_package(package: str, name: str, environment: Mapping[str, str]) -> Path:
    own = _own_files()
    if package == packages.OWN and name in own:
        return own[name]
    share = packages.share_of(package, environment)
    folder = share / 'launch' if package == packages.OWN else share  # a source tree holds much more than launch files
    found = sorted(Path(root) / name for root, _, files in os.walk(folder) if name in files)
    if len(found) > 1:
        raise LaunchFileError(f"'{name}' is found more than once in package '{package}': {', '.join(map(str, found))}")
    if not found:
        raise LaunchFileError(f"package '{package}' has no launch file '{name}' below {folder}{suggestion(name, own)}")
    return found[0]


def _own_files() -> dict[str, Path]:
    folder = paths.share_directory() / 'launch'
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()) if folder.is_dir() else []:
        for suffix in SUFFIXES:
            if file.name.endswith(suffix):
                found.setdefault(file.name.removesuffix(suffix), file)
                break
    return found
