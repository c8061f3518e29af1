"""What the documentation points to is there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').glob('**/*.md'))]
LINK = re.compile(r'\]\((?!https?://)([^)#\s]*)(?:#([^)\s]*))?\)')


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_of_a_page_leads_to_a_file_and_a_heading(page: Path) -> None:
    for name, heading in LINK.findall(page.read_text(encoding='utf-8')):
        target = page.parent / name if name else page
        assert target.exists(), f'{page.name} points to {name}, which is not there'
        if heading and target.suffix == '.md':
            assert heading in anchors(target), f'{page.name} points to {name}#{heading}, a heading that is not there'


@pytest.mark.parametrize('page', sorted((ROOT / 'docs').glob('*.md')), ids=lambda page: page.name)
def test_the_index_leads_to_every_page(page: Path) -> None:
    assert page.name == 'README.md' or f']({page.name}' in (ROOT / 'docs/README.md').read_text(encoding='utf-8')


def test_files_that_additions_touch_hold_what_is_to_be_added_there() -> None:
    """`FLOW_METHODS`, `NODES`: names in capitals, in the row of the file that has them."""
    found = 0
    for row in (ROOT / 'docs/extending.md').read_text(encoding='utf-8').splitlines():
        files = [ROOT / name for name in re.findall(r'`([\w/.]+\.(?:py|txt))`', row.partition(' | ')[0])]
        texts = [file.read_text(encoding='utf-8') for file in files if file.is_file()]
        for name in re.findall(r'`([A-Z][A-Z_]{4,})`', row) if texts else ():
            assert any(re.search(rf'\b{name}\b', text) for text in texts), f'{name} stands in none of {files}'
            found += 1
    assert found > 5


def anchors(page: Path) -> Iterator[str]:
    """Headings as they are linked to: lower case, blanks as dashes, no other marks."""
    for title in re.findall(r'(?m)^#+ (.*)$', page.read_text(encoding='utf-8')):
        yield re.sub(r'[^\w\- ]', '', title.lower()).strip().replace(' ', '-')
