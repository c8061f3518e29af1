"""What the random run finds is kept, so that it can become a test."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
RANDOM_TEST = """
from hypothesis import given, strategies as st

@given(st.integers())
def test_small(number):
    print('tried', number)
    assert number < 1000
"""
LONG_TESTS = """
LONG = st.just(b'x' * 4000)  # characters; a report may have 3000 of one argument

@given(number=LONG)
def test_an_argument(number):
    pass

@given(number=st.data())
def test_drawn_in_the_midst(number):
    number.draw(LONG)
"""


def ran(file: Path, found: Path, seed: int) -> str:
    """What pytest says of a file, run as `make fuzz` runs the suite."""
    environment = {
        'TACTILE_HYPOTHESIS': 'fuzz',
        'TACTILE_SEED': str(seed),
        'TACTILE_FOUND': str(found),
        'PYTHONPATH': str(TESTS),
    }
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'conftest', '-m', 'hypothesis', str(file)]
    return subprocess.run(
        command,
        cwd=TESTS.parent,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    ).stdout


@pytest.fixture(scope='module')
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What the first run says, and the folder with what it found."""
    folder = tmp_path_factory.mktemp('first')
    file, found = folder / 'test_random.py', folder / 'found'
    file.write_text(RANDOM_TEST + LONG_TESTS)
    return ran(file, found, 7), found


def test_what_a_random_run_finds_is_kept_and_tried_first_and_a_seed_tries_the_same_again(
    first: tuple[str, Path], tmp_path: Path
) -> None:
    said, found = first
    (kept,) = found.glob('*test_small-*.txt')
    assert str(kept) in said
    text = kept.read_text()
    assert 'make fuzz SEED=7' in text
    assert 'number=1000' in text  # the smallest that fails
    decorator = re.search(r"@reproduce_failure\('[\d.]+', (b'.*?')\)", text)
    assert decorator is not None
    assert ast.literal_eval(decorator[1])

    # The next round tries it before it draws any other.
    file = found.parent / 'test_random.py'
    file.write_text(RANDOM_TEST)
    assert tried(ran(file, found, 8))[0] == '1000'

    # Where nothing was found before, a seed has the same examples tried.
    assert tried(ran(file, tmp_path / 'other', 7)) == tried(said)


def test_what_is_drawn_is_short(first: tuple[str, Path]) -> None:
    """Else it would fill the report, so that nobody sees what was found."""
    for test in ('test_an_argument', 'test_drawn_in_the_midst'):
        reported = first[0].split(f'_ {test} _')[1].split('\n____', maxsplit=1)[0]
        assert 'give a path or a seed, draw what it is made of' in reported


def tried(said: str) -> list[str]:
    """What the random test printed."""
    return re.findall(r'tried (-?\d+)', said)
