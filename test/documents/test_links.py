"""What the documentation points to is there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').glob('**/*.md'))]
LINK = re.compile(r'\]\((?!https?://)([^)#\s]*)(?:#([^)\s]*))?\)')

STUDY = re.compile(r'`(?:PYTHONPATH=(\S+) )?python (test/\S+\.py)')
STUDIES = sorted({found for page in PAGES for found in STUDY.findall(page.read_text(encoding='utf-8'))})


def test_every_link_of_a_page_leads_to_a_file_and_a_heading() -> None:
    wrong = []
    for page in PAGES:
        for name, heading in LINK.findall(page.read_text(encoding='utf-8')):
            target = page.parent / name if name else page
            if not target.exists() or (heading and target.suffix == '.md' and heading not in anchors(target)):
                wrong.append(f'{page.relative_to(ROOT)} points to {name}#{heading}')
    assert not wrong


def test_the_index_leads_to_every_page() -> None:
    index = (ROOT / 'docs/README.md').read_text(encoding='utf-8')
    pages = {page.name for page in (ROOT / 'docs').glob('*.md')}
    assert [name for name in sorted(pages - {'README.md'}) if f']({name}' not in index] == []


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


@cache
def anchors(page: Path) -> set[str]:
    """Headings as they are linked to: lower case, blanks as dashes, no other marks."""
    titles = re.findall(r'(?m)^#+ (.*)$', page.read_text(encoding='utf-8'))
    return {re.sub(r'[^\w\- ]', '', title.lower()).strip().replace(' ', '-') for title in titles}


@pytest.mark.parametrize(('searched', 'script'), STUDIES)
def test_a_study_finds_its_modules_where_its_page_says(searched: str, script: str) -> None:
    """As `python script` would, but without its measurements, which take minutes."""
    folder = str((ROOT / script).parent)
    code = f'import runpy, sys; sys.path[0] = {folder!r}; runpy.run_path({script!r}, run_name="read")'
    environment = {**os.environ, 'PYTHONPATH': searched}
    ended = subprocess.run([sys.executable, '-c', code], cwd=ROOT, env=environment, stderr=subprocess.PIPE, check=False)
    assert not ended.returncode, ended.stderr.decode()
