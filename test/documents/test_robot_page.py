"""The page for robots tells of the loop that the code has."""

from __future__ import annotations

import re
from pathlib import Path

from tactile_nodes.collection.press.guarded import GuardSettings

PAGE = (Path(__file__).parents[2] / 'docs/robots.md').read_text(encoding='utf-8')


def test_the_loop_is_told_with_the_numbers_that_it_has() -> None:
    told, text = GuardSettings(), re.sub(r'\s+', ' ', PAGE)
    assert f'one step of at most {told.step_mm:g} mm' in text
    assert (
        f'A step is {told.gain:g} of the missing force over the steepest stiffness expected '
        f'({told.stiffness_n_mm:g} N/mm)' in text
    )
    assert f'Within {told.band_n:g} N of the target' in text
    assert f'above {told.limit_n:g} N or older than {told.stale_ms:g} ms, after {told.travel_mm:g} mm' in text
    assert f'after {told.seconds:g} s' in text
