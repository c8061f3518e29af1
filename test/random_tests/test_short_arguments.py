"""Arguments that would fill the report of a random test are refused, so that what was found is seen."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_found_examples import ran

LONG = 4000  # characters; a report may have 3000 of one argument


@pytest.mark.parametrize(
    ('given', 'body'),
    [
        (f'number=st.just(b"x" * {LONG})', 'pass'),
        ('number=st.data()', f'number.draw(st.just(b"x" * {LONG}))'),
    ],
    ids=['an argument', 'drawn in the midst'],
)
def test_what_is_drawn_is_short(given: str, body: str, tmp_path: Path) -> None:
    file = tmp_path / 'test_long.py'
    file.write_text(
        f'from hypothesis import given, strategies as st\n\n@given({given})\ndef test_long(number):\n    {body}\n'
    )
    said = ran(file, tmp_path / 'found', 7)
    assert '1 failed' in said
    assert 'give a path or a seed, draw what it is made of' in said
