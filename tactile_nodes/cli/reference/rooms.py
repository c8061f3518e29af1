"""The part of the documentation that says where a thing is: every folder of the package, by its own first line."""

from __future__ import annotations

import ast
from pathlib import Path

from tactile_nodes.cli.reference.pages import code, table

PACKAGE = Path(__file__).parents[2]
ONE_EACH = ('cli',)
"""Its folders are single verbs, which have a page of their own."""


def rooms() -> str:
    """Folders, and what is done in them."""
    folders = sorted(file.parent for file in PACKAGE.rglob('__init__.py'))
    shown = [each for each in folders if each != PACKAGE and each.parent.name not in ONE_EACH]
    rows = [[code(f'{each.relative_to(PACKAGE)}/'), _first_line(each)] for each in shown]
    return table(['folder', 'what is done in it'], rows)


def _first_line(folder: Path) -> str:
    text = ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0]
