"""The parts of the documentation that say where a thing is: every folder, by its first line; who may import whom."""

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
"""Its folders are single verbs, which have a page of their own."""


def rooms() -> str:
    """Folders, and what is done in them."""
    folders = sorted(file.parent for file in PACKAGE.rglob('__init__.py'))
    shown = [each for each in folders if each != PACKAGE and each.parent.name not in ONE_EACH]
    rows = [[code(f'{each.relative_to(PACKAGE)}/'), _first_line(each)] for each in shown]
    return table(['folder', 'what is done in it'], rows)


def imports() -> str:
    """The order of imports, from the top down, as import-linter holds it.

    Raises:
        ConfigurationError: no source tree, or an order that stands there in another way.
    """
    file = share_directory() / 'pyproject.toml'
    found = LAYERS.search(read_text(file)) if file.is_file() else None
    if found is None:
        raise ConfigurationError(f'{file} has no list "layers" of its own lines; run this in a source tree')
    return '\n'.join(['```text', *(re.sub('[()]', '', layer) for layer in ast.literal_eval(found[1])), '```'])


def _first_line(folder: Path) -> str:
    text = ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0]
