"""The chart of speed against accuracy: other people's methods measure what they should, and the front is the front."""

from __future__ import annotations

import dataclasses
import sys
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks import front
from benchmarks.front.contenders import WAYS, Contender, Measuring, Way, contenders
from benchmarks.front.flows import SmallPixels
from benchmarks.front.frames import Plan
from benchmarks.front.page import page
from benchmarks.harness.report import surroundings
from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.patches import moved_image

WHITE = np.random.default_rng(2).normal(0, 1, (440, 440))
NOISE = sum(size * cv2.GaussianBlur(WHITE, (0, 0), size) for size in (1.0, 2.0, 4.0))
PATTERN = np.clip(110 + 40 * NOISE / NOISE.std(), 0, 255).astype(np.uint8)
"""Structure of several sizes: a quarter of the picture still shows some, and phase correlation wants the finest."""
QUICK_WAYS = [way for way in WAYS if not way.slow]


@pytest.mark.parametrize('way', [way for way in QUICK_WAYS if way.name != 'small pixels'], ids=lambda way: way.name)
def test_every_way_reads_a_shift_of_two_pixels(way: Way) -> None:
    measuring = Measuring(way, [(10, 'cartesian_mean')])
    measuring.set_reference(PATTERN)
    moved = np.clip(np.round(moved_image(PATTERN.astype(np.float32), 2.0, -1.0)), 0, 255).astype(np.uint8)
    ((_, flow),) = measuring.flows()
    features = measuring.encode(10, 'cartesian_mean', flow(moved))
    assert features.values.shape == (10, 10, 2)
    np.testing.assert_allclose(np.median(features.values, axis=(0, 1)), [2.0, -1.0], atol=0.4)


def test_small_pixels_are_how_much_brighter_a_region_is() -> None:
    way = SmallPixels(20)
    way.set_reference(PATTERN)
    brighter = PATTERN.copy()
    brighter[:22, :22] = PATTERN[:22, :22] // 2 + 60
    found: Any = way(brighter)
    assert isinstance(found, Features)
    assert found.values.shape == (20, 20, 1)
    change = (brighter[:22, :22].astype(float) - PATTERN[:22, :22]).mean()
    assert (found.values[0, 0, 0], found.values[5, 5, 0]) == (pytest.approx(change, abs=1e-3), 0.0)


def test_frames_of_the_test_have_rest_images_of_their_own() -> None:
    plan = Plan(train=4, test=3)
    seen, tested = list(front.frames(plan)), list(front.frames(plan, tested_only=True))
    assert len(seen) == 7
    assert len({id(each.rest) for each in seen[:4]}) == 1
    assert (seen[0].rest != seen[4].rest).any()
    assert all((each.press[3] > 0) == (each.press[2] > 0) for each in seen)
    assert [each.press for each in tested] == [each.press for each in seen[4:]]
    assert all((one.image == two.image).all() for one, two in zip(tested, seen[4:], strict=True))


def test_contenders_have_names_of_their_own() -> None:
    every = contenders(WAYS, networks=True)
    assert len({each.name for each in every}) == len(every)
    assert sum(each.readout == 'network' for each in every) == 4


def test_a_short_run_scores_and_times_all_and_finds_the_front(monkeypatch: pytest.MonkeyPatch) -> None:
    """With coarser responses than those of the chart, which need fewer frames to learn from; of these more at rest."""
    usual, coarse = Contender.config, ResponseConfig(components=24, spacing_mm=3.5)
    monkeypatch.setattr(Contender, 'config', lambda contender: dataclasses.replace(usual(contender), response=coarse))
    monkeypatch.setattr(sys.modules[Plan.__module__], 'STILL_SHARE', 0.2)
    ways = [way for way in WAYS if way.name in ('ours, quarter size', 'small pixels')]
    ways = [Way(way.name, way.make, (10,), way.by_grid) for way in ways]
    result = front.measure(ways, Plan(train=110, test=12, compiled=False), Progress())
    ours, pixels = result['contenders']['ours, quarter size, 10x10'], result['contenders']['small pixels, 10x10']
    assert ours['armse_n'] < 0.03
    assert ours['armse_n'] < pixels['armse_n']
    assert 0 < ours['stages_cpu_ms']['flow and features'] < ours['cpu_ms']['median']
    assert 'ours, quarter size, 10x10' in result['fronts']['armse_n']
    text = page({**surroundings('tactile bench front'), **result})
    assert '| ours, quarter size, 10x10 |' in text
    assert '- aRMSE [N]: ' in text
    shipped = result['profiles']
    assert shipped['fast']['armse_n'] < shipped['paper']['armse_n']
    assert shipped['fast']['cpu_ms']['median'] < shipped['paper']['cpu_ms']['median']
    assert shipped['fast']['cpu_ms']['median'] > result['floors_cpu_ms']['reading 440x440 bytes once']
    assert shipped['fast']['chain_cpu_ms']['median'] < shipped['paper']['chain_cpu_ms']['median']


def test_the_front_is_by_time_and_each_error() -> None:
    def entry(ms: float, *errors: float) -> dict[str, Any]:
        return {'cpu_ms': {'median': ms}, **dict(zip(front.ERRORS, errors, strict=True))}

    table = {'a': entry(1.0, 5.0, 1.0, 9.0), 'b': entry(2.0, 4.0, 2.0, 9.0), 'c': entry(3.0, 4.5, 0.5, 8.0)}
    assert front.fronts(table) == {'armse_n': ['a', 'b'], 'd_loc_mm': ['a', 'c'], 'rmse_mc_n': ['a', 'c']}
