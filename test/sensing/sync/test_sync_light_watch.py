"""A light watched frame by frame tells what the whole run tells afterwards."""

from __future__ import annotations

import numpy as np
import pytest
from light_runs import light_edges

from tactile_nodes.emulators.camera_stream import light_brightness
from tactile_nodes.emulators.world import Edge
from tactile_nodes.sensing.sync.clocks import ClockFit, SyncLimits, fit_clocks
from tactile_nodes.sensing.sync.light import LightWatch

PERIOD_NS = 16_666_667
EXPOSURE_S = 0.008


def film(edges: list[Edge], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    start_ns = np.arange(0, round(seconds * 1e9), PERIOD_NS)
    noise = np.random.default_rng(1).normal(0, 0.5, len(start_ns))
    return start_ns, np.array([light_brightness(edges, int(each), EXPOSURE_S) for each in start_ns]) + noise


def watched(start_ns: np.ndarray, brightness: np.ndarray) -> list[tuple[int, bool, float]]:
    watch = LightWatch(EXPOSURE_S)
    found = []
    for at_ns, level in zip(start_ns, brightness, strict=True):
        edges = watch.take(int(at_ns), float(level))
        found += list(zip(edges.stamp_ns.tolist(), edges.level.tolist(), edges.uncertainty_s.tolist(), strict=True))
    return found


@pytest.fixture
def edges() -> list[Edge]:
    times = np.cumsum(np.random.default_rng(2).uniform(0.1, 0.7, 40))
    return [Edge(round(time_s * 1e9), number % 2 == 0) for number, time_s in enumerate(times)]


def test_every_edge_is_reported_once_as_the_whole_run_tells_it_and_within_what_it_says_of_itself(
    edges: list[Edge],
) -> None:
    start_ns, brightness = film(edges, edges[-1].stamp_ns / 1e9 + 1)
    found, whole = watched(start_ns, brightness), light_edges(start_ns, brightness, EXPOSURE_S)
    assert np.abs(np.array([stamp for stamp, _, _ in found]) - whole.stamp_ns).max() < 1_000_000
    assert [level for _, level, _ in found] == whole.level.tolist()
    assert [level for _, level, _ in found] == [edge.level for edge in edges]
    for (stamp_ns, _, half_s), edge in zip(found, edges, strict=True):
        # Half a millisecond for noise of half a grey level in 200, and for levels that are learnt on the way.
        assert abs(stamp_ns - edge.stamp_ns) <= half_s * 1e9 + 500_000


def test_a_light_that_was_dark_for_long_is_seen_when_it_goes_on() -> None:
    edges = [Edge(100_000_000, True), Edge(600_000_000, False), Edge(14_000_000_000, True)]
    found = watched(*film(edges, 14.2))
    assert [level for _, level, _ in found] == [True, False, True]
    assert abs(found[-1][0] - edges[-1].stamp_ns) < 10_000_000


def test_an_edge_is_reported_three_frames_after_it() -> None:
    watch = LightWatch(EXPOSURE_S)
    reported = [len(watch.take(number * PERIOD_NS, 200.0 if number >= 50 else 20.0).stamp_ns) for number in range(60)]
    assert reported.index(1) == 53
    assert sum(reported) == 1


def test_a_scene_without_a_light_has_no_edges() -> None:
    brightness = 100 + np.random.default_rng(3).normal(0, 2, 1000)
    assert watched(np.arange(1000) * PERIOD_NS, brightness) == []


def test_a_camera_that_watches_the_light_is_brought_to_the_rigs_clock() -> None:
    """0.3 s and 100 ppm off, at 60 frames a second: three of four edges are known to 4.3 ms only, the others to 1.2 ms.

    A uniform error of 4.3 ms is 2.5 ms rms; with 70 edges the line errs by 2 * 2.5 / sqrt(70) = 0.6 ms at its ends.
    """
    times = np.cumsum(np.random.default_rng(4).uniform(0.2, 0.7, 70))
    edges = [Edge(round(time_s * 1e9), number % 2 == 0) for number, time_s in enumerate(times)]
    start_ns, brightness = film(edges, times[-1] + 1)
    camera_ns = np.round((start_ns - 300_000_000) / 1.0001).astype(np.int64)
    stamps, levels, halves = (np.array(column) for column in zip(*watched(camera_ns, brightness), strict=True))
    host = np.array([edge.stamp_ns for edge in edges])
    host_levels = np.array([edge.level for edge in edges])
    fit = fit_clocks(stamps, host, SyncLimits(0.01), levels, host_levels, halves)
    assert isinstance(fit, ClockFit), fit
    assert np.abs(fit.host_ns(camera_ns) - start_ns).max() < 2_000_000
