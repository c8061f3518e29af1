"""Random tests try the same examples on every run, whatever else was imported before them."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st


def tried() -> list[tuple[float, int, str]]:
    """What a random test tries."""
    found = []

    @given(st.floats(), st.integers(), st.text(max_size=5))
    def collect(number: float, whole: int, text: str) -> None:
        found.append((number, whole, text))

    collect()
    return found


@pytest.mark.skipif(os.environ.get('TACTILE_HYPOTHESIS') == 'fuzz', reason='make fuzz tries others each time')
def test_what_is_tried_does_not_hang_on_what_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hypothesis takes some examples from numbers and texts in the modules that it finds imported."""
    before = tried()
    numbers = ', '.join(f"{each + 0.25}, {each + 100_000}, 't{each}'" for each in range(40, 52))
    (tmp_path / 'full_of_numbers.py').write_text(f'NUMBERS = [{numbers}]\n')
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.import_module('full_of_numbers')
    assert len(before) == 100
    assert repr(tried()) == repr(before)
