"""Flow alone against known motion: what counts as error and as bias, and the short form of the bench."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import motion
from benchmarks.flow.errors import Errors
from benchmarks.front.contenders import WAYS
from benchmarks.harness.report import surroundings
from tactile_nodes.learning.progress import Progress


def test_bias_is_the_error_along_the_motion() -> None:
    """Two regions that moved 5 and 2 px, read 1 px short and 0.5 px too long: -0.25 px; rms of (1, 0.5) over 4 axes."""
    errors = Errors([np.array([[-0.6, -0.8], [0.0, -0.5]])], [np.array([[3.0, 4.0], [0.0, -2.0]])])
    summary = errors.along_motion()
    assert summary['bias_px'] == pytest.approx(-0.25)
    assert summary['rms_px'] == pytest.approx(np.sqrt((0.36 + 0.64 + 0.25) / 4))


def test_regions_are_chosen_by_their_true_motion() -> None:
    errors = Errors([np.array([[0.1, 0.0], [0.0, 0.7]])], [np.array([[0.3, 0.0], [0.0, 2.0]])])
    assert errors.along_motion(1.0, 5.0)['rms_px'] == pytest.approx(0.7 / 2**0.5)
    assert errors.along_motion(10.0, 20.0)['regions'] == 0


def test_pixels_without_motion_take_no_part() -> None:
    names = [way.name for way in motion.flow_ways()]
    assert 'small pixels' not in names
    assert len(names) == len(WAYS) - 1


def test_known_motion_comes_back_and_the_page_tells_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, 'SIZES_PX', (0.1, 2.0))
    ways = [way for way in motion.flow_ways() if way.name == 'ours, half size']
    result = motion.measure(ways, 1, 1, None, Progress())
    moved = result['moved']['moved by 2 px']['ours, half size']
    assert moved['rms_px'] < 0.05
    assert abs(moved['bias_px']) < 0.03
    text = motion.page({**surroundings('tactile bench motion'), **result})
    assert '| method          | CPU [ms] |         0.1 px |           2 px |' in text
