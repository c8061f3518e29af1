"""Where packages and their executables are: the ament prefixes, and this package wherever it is installed.

An executable of this package is a program in ``<prefix>/lib/tactile_nodes`` after a colcon build, a console script
beside the interpreter after ``pip install``, and in a bare source tree `nodes.composed` with its name.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from tactile_nodes import paths
from tactile_nodes.launching.document import suggestion
from tactile_nodes.launching.template import SubstitutionError

OWN = paths.PACKAGE
_MARKERS = Path('share/ament_index/resource_index/packages')


def find_prefix(package: str, environment: Mapping[str, str]) -> Path | None:
    """The first prefix of ``AMENT_PREFIX_PATH`` in which a package is installed."""
    for prefix in _prefixes(environment) if '/' not in package else []:
        if (prefix / _MARKERS / package).is_file():
            return prefix
    return None


def package_names(environment: Mapping[str, str]) -> list[str]:
    """All available packages, including this one."""
    found = {OWN}
    for prefix in _prefixes(environment):
        if (prefix / _MARKERS).is_dir():
            found.update(marker.name for marker in (prefix / _MARKERS).iterdir())
    return sorted(found)


def prefix_of(package: str, environment: Mapping[str, str]) -> Path:
    """The folder under which a package is installed; for this package in a source tree, that tree.

    Raises:
        SubstitutionError: no such package.
    """
    if found := find_prefix(package, environment):
        return found
    if package == OWN:
        share = paths.share_directory()
        return share.parent.parent if share.parent.name == 'share' else share
    searched = environment.get('AMENT_PREFIX_PATH') or 'AMENT_PREFIX_PATH, which is empty'
    raise SubstitutionError(f"package '{package}' not found, searching {searched}")


def share_of(package: str, environment: Mapping[str, str]) -> Path:
    """The share folder of a package, or `SubstitutionError`."""
    if package == OWN:
        return paths.share_directory()
    return prefix_of(package, environment) / 'share' / package


def command_of(package: str, executable: str, environment: Mapping[str, str]) -> list[str]:
    """The command that starts an executable of a package: its path, or an interpreter and a module.

    Raises:
        SubstitutionError: no such package, or no such executable in it.
    """
    program = prefix_of(package, environment) / 'lib' / package / executable
    if program.is_file() and os.access(program, os.X_OK):
        return [str(program)]
    if package == OWN and executable in own_executables():
        return _own_command(executable)
    executables = executables_of(package, environment)
    raise SubstitutionError(
        f"package '{package}' has no executable '{executable}'{suggestion(executable, executables)}"
    )


def executables_of(package: str, environment: Mapping[str, str]) -> list[str]:
    folder = prefix_of(package, environment) / 'lib' / package
    found = {f.name for f in folder.iterdir() if os.access(f, os.X_OK) and f.is_file()} if folder.is_dir() else set()
    return sorted(found | (own_executables().keys() if package == OWN else set()))


def own_executables() -> dict[str, str]:
    """The nodes of this package, executable -> module: camera_node -> tactile_nodes.nodes.camera.

    Read from the package itself, not from an installer's list, which an upgrade may have left outdated.
    """
    package = importlib.util.find_spec(f'{OWN}.nodes')
    folders = (package.submodule_search_locations if package else None) or []
    found = {}
    for folder in map(Path, folders):
        for module in sorted(folder.rglob('[a-z]*.py'), key=lambda file: file.stem):
            name = '.'.join(module.relative_to(folder).with_suffix('').parts)
            found[f'{module.stem.removesuffix("_node")}_node'] = f'{OWN}.nodes.{name}'
    return found


def source_environment(command: list[str]) -> dict[str, str]:
    """Environment variables with which a child can import this package from a source tree, in any folder."""
    if command[1:2] != ['-m']:
        return {}
    root = str(Path(paths.__file__).resolve().parent.parent)
    return {'PYTHONPATH': os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))}


def _own_command(executable: str) -> list[str]:
    script = Path(sys.executable).parent / f'tactile_{executable}'  # bin/ is shared by all that pip installs
    if script.is_file() and os.access(script, os.X_OK):
        return [str(script)]
    program = [sys.executable, '-m', f'{OWN}.nodes.composed']
    return program if executable == 'composed_node' else [*program, executable.removesuffix('_node')]


def _prefixes(environment: Mapping[str, str]) -> list[Path]:
    return [Path(prefix) for prefix in environment.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
