"""Arguments that would fill the report of a random test are refused, so that what was found is seen."""

from __future__ import annotations

from pathlib import Path

from test_found_examples import ran

LONG_TESTS = """
from hypothesis import given, strategies as st

LONG = st.just(b'x' * 4000)  # characters; a report may have 3000 of one argument

@given(number=LONG)
def test_an_argument(number):
    pass

@given(number=st.data())
def test_drawn_in_the_midst(number):
    number.draw(LONG)
"""


def test_what_is_drawn_is_short(tmp_path: Path) -> None:
    file = tmp_path / 'test_long.py'
    file.write_text(LONG_TESTS)
    said = ran(file, tmp_path / 'found', 7)
    assert '2 failed' in said
    for test in ('test_an_argument', 'test_drawn_in_the_midst'):
        reported = said.split(f'_ {test} _')[1].split('\n____')[0]
        assert 'give a path or a seed, draw what it is made of' in reported
