"""A light in the camera's view: its edges to a part of a frame."""

from __future__ import annotations

import numpy as np
import pytest
from light_runs import LightEdges, light_edges

MS = 1_000_000


def frames(count: int = 12, period_ms: float = 16.0) -> np.ndarray:
    return np.round(np.arange(count) * period_ms * MS).astype(np.int64)


def brightness(start_ns: np.ndarray, on_ns: int, off_ns: int, exposure_ms: float) -> np.ndarray:
    """20 grey levels in the dark, 220 lit throughout, and in proportion to the lit part of the exposure."""
    end_ns = start_ns + exposure_ms * MS
    lit = np.clip(np.minimum(end_ns, off_ns) - np.maximum(start_ns, on_ns), 0, None)
    return 20 + 200 * lit / (exposure_ms * MS)


def edges_seen(on_ms: float, off_ms: float = 500.0, exposure_s: float = 0.010) -> LightEdges:
    """What twelve frames, each exposed for 10 ms, show of a light; `exposure_s` is what is known of them."""
    start = frames()
    return light_edges(start, brightness(start, round(on_ms * MS), round(off_ms * MS), 10.0), exposure_s)


def test_a_partly_lit_frame_tells_when_the_light_went_on_and_off() -> None:
    """Exposed for 10 of every 16 ms; on at 39 ms, 7 ms into the frame of 32; off at 101 ms, 5 ms into that of 96."""
    edges = edges_seen(39, 101)
    assert edges.stamp_ns.tolist() == [39 * MS, 101 * MS]
    assert edges.level.tolist() == [True, False]
    assert edges.uncertainty_s == pytest.approx([0.0015, 0.0015])


def test_an_edge_between_two_exposures_is_put_into_the_middle_of_the_gap() -> None:
    """The exposure of the frame at 32 ms ends at 42; the next begins at 48. The ends of the curve add 1.5 ms each."""
    edges = edges_seen(44)
    assert edges.stamp_ns.tolist() == [45 * MS]
    assert edges.uncertainty_s == pytest.approx([0.0045])


@pytest.mark.parametrize('on_ms', np.arange(33.0, 49.0, 1.5))
def test_the_true_time_lies_within_the_stated_uncertainty(on_ms: float) -> None:
    edges = edges_seen(on_ms)
    assert len(edges.stamp_ns) == 1
    assert abs(edges.stamp_ns[0] / MS - on_ms) <= 1e3 * edges.uncertainty_s[0] + 1e-6


def test_without_a_known_exposure_the_edge_lies_between_the_frames() -> None:
    edges = edges_seen(39, exposure_s=0.0)
    assert edges.stamp_ns.tolist() == [32 * MS]  # between the dark frame of 16 ms and the bright one of 48 ms
    assert edges.uncertainty_s == pytest.approx([0.016])


def test_lost_frames_only_make_the_time_less_certain() -> None:
    start = frames()
    seen = brightness(start, 39 * MS, 500 * MS, 10.0)
    kept = np.array([0, 1, 5, 6, 7])
    edges = light_edges(start[kept], seen[kept], 0.010)
    assert edges.uncertainty_s[0] > 0.02
    assert abs(edges.stamp_ns[0] / MS - 39) <= 1e3 * edges.uncertainty_s[0]


def test_a_picture_that_only_flickers_has_no_edges() -> None:
    noise = np.random.default_rng(1).normal(100, 3, 300)
    assert len(light_edges(frames(300), noise, 0.010).stamp_ns) == 0


def test_a_flash_within_one_frame_gives_no_edge() -> None:
    start = frames(40)
    seen = brightness(start, 300 * MS, 500 * MS, 10.0)
    seen[5] = 100.0
    assert light_edges(start, seen, 0.010).level.tolist() == [True, False]


@pytest.mark.parametrize('count', [0, 1])
def test_next_to_no_frames_give_no_edges(count: int) -> None:
    assert len(light_edges(frames(count), np.zeros(count), 0.010).stamp_ns) == 0
