"""The parts of the documentation about the structure of the source: all folders, and the order of imports."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import tactile_nodes
from reference.pages import code, table
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_text
from tactile_nodes.paths import share_directory

PACKAGE = Path(tactile_nodes.__file__).parent
LAYERS = re.compile(r'^layers = (\[.*?^\])', re.MULTILINE | re.DOTALL)
ONE_EACH = ('cli',)
"""Folders whose subfolders are single commands, which have their own page."""


def rooms() -> str:
    """A table of all folders, with the first line of their docstrings."""
    folders = sorted(file.parent for file in PACKAGE.rglob('__init__.py'))
    shown = [each for each in folders if each != PACKAGE and each.parent.name not in ONE_EACH]
    rows = [[code(f'{each.relative_to(PACKAGE)}/'), _first_line(each)] for each in shown]
    return table(['folder', 'what is done in it'], rows)


def imports() -> str:
    """The order of imports, from the top down, as import-linter enforces it.

    Raises:
        ConfigurationError: there is no source tree, or the order in it has another format.
    """
    file = share_directory() / 'pyproject.toml'
    found = LAYERS.search(read_text(file)) if file.is_file() else None
    if found is None:
        raise ConfigurationError(f'{file} has no list "layers" of its own lines; run this in a source tree')
    return '\n'.join(['```text', *(re.sub('[()]', '', layer) for layer in ast.literal_eval(found[1])), '```'])


def _first_line(folder: Path) -> str:
    text = ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0]
