"""The page for robots tells of the loop that the code has."""

from __future__ import annotations

import re
from pathlib import Path

from tactile_nodes.collection.press.guarded import GuardSettings

PAGE = (Path(__file__).parents[2] / 'docs/robots.md').read_text(encoding='utf-8')


def test_the_loop_is_reported_with_the_numbers_that_it_has() -> None:
    settings, text = GuardSettings(), re.sub(r'\s+', ' ', PAGE)
    assert f'one step of at most {settings.step_mm:g} mm' in text
    assert (
        f'A step is {settings.gain:g} of the missing force over the steepest stiffness expected '
        f'({settings.stiffness_n_mm:g} N/mm)' in text
    )
    assert f'Within {settings.band_n:g} N of the target' in text
    assert (
        f'above {settings.limit_n:g} N or older than {settings.stale_ms:g} ms, after {settings.travel_mm:g} mm' in text
    )
    assert f'after {settings.seconds:g} s' in text
