"""The page of the bench of contacts is what its numbers say."""

import json
from pathlib import Path

from benchmarks.contacts.page import draw, page

RESULTS = Path(__file__).parents[2] / 'docs' / 'results'


def test_the_page_that_is_published_follows_from_the_numbers_beside_it() -> None:
    result = json.loads((RESULTS / 'contacts.json').read_text(encoding='utf-8'))
    assert page(result) + '\n' == (RESULTS / 'contacts.md').read_text(encoding='utf-8')


def test_the_chart_is_drawn(tmp_path: Path) -> None:
    draw(json.loads((RESULTS / 'contacts.json').read_text(encoding='utf-8')), tmp_path / 'contacts.png')
    assert (tmp_path / 'contacts.png').read_bytes().startswith(b'\x89PNG')
