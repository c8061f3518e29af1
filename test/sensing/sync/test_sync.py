"""Two recorders of one line: offset and drift are found within bounds that follow from theory, or refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.sync.clocks import ClockFit, Reason, Refusal, SyncLimits, fit_clocks
from tactile_nodes.sensing.sync.envelope import lower_line
from tactile_nodes.sensing.sync.matching import nearest, without_bounces
from tactile_nodes.sensing.sync.robust import bend, overlooked, robust_line

HOST_ZERO_NS = 1_795_000_000_000_000_000
SOME = settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))


def line(count: int, rng: np.random.Generator, low_s: float = 0.5, high_s: float = 3.0) -> np.ndarray:
    """Edges at irregular times, in seconds."""
    return np.cumsum(rng.uniform(low_s, high_s, count))


def recorded(
    edges_s: np.ndarray, rng: np.random.Generator, missing: float = 0.05, doubled: float = 0.05, jitter_s: float = 0.001
) -> np.ndarray:
    """What a recorder writes down, in integer ns: some missing, some twice within 30 ms, all with uniform jitter."""
    seen = edges_s[rng.random(len(edges_s)) >= missing]
    again = seen[rng.random(len(seen)) < doubled]
    times = np.concatenate(
        [seen + rng.uniform(-jitter_s, jitter_s, len(seen)), again + rng.uniform(0.003, 0.03, len(again))]
    )
    return np.round(np.sort(times) * 1e9).astype(np.int64)


def device_time(host_s: np.ndarray, offset_s: float, drift_ppm: float) -> np.ndarray:
    """On a clock of which t_host = offset + (1 + drift) t_device."""
    return (host_s - offset_s) / (1 + drift_ppm * 1e-6)


def worst_error_s(fit: ClockFit, device_s: np.ndarray, offset_s: float, drift_ppm: float) -> float:
    """Over the whole run, at times between the edges too."""
    times = np.linspace(device_s[0], device_s[-1], 500)
    found = (fit.host_ns(np.round(times * 1e9).astype(np.int64)) - HOST_ZERO_NS) / 1e9
    return float(np.abs(found - offset_s - (1 + drift_ppm * 1e-6) * times).max())


def fitted(*recordings: object) -> ClockFit:
    fit = fit_clocks(*recordings)  # type: ignore[arg-type]
    assert isinstance(fit, ClockFit), fit
    return fit


def refused(*recordings: object) -> Refusal:
    refusal = fit_clocks(*recordings)  # type: ignore[arg-type]
    assert isinstance(refusal, Refusal), refusal.bound_s
    return refusal


@SOME
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(60, 400),
    offset_s=st.floats(-0.3, 0.3),
    drift_ppm=st.floats(-100, 100),
    missing=st.floats(0, 0.05),
    doubled=st.floats(0, 0.05),
    jitter_s=st.floats(0, 0.002),
)
def test_time_is_recovered_better_than_2_ms_everywhere(
    seed: int, count: int, offset_s: float, drift_ppm: float, missing: float, doubled: float, jitter_s: float
) -> None:
    """Two recorders with uniform jitter j: a pair is off by j sqrt(2/3) rms.

    A line through k points, even over the run, errs at its end by that times sqrt(4 / k); five times this is never
    exceeded. Of the edges (1 - missing)^2 have a partner; 0.1 ms is granted for doubled edges inside the jitter.
    """
    rng = np.random.default_rng(seed)
    host_s = line(count, rng)
    device_s = device_time(host_s, offset_s, drift_ppm)
    host = recorded(host_s, rng, missing, doubled, jitter_s) + HOST_ZERO_NS
    fit = fitted(recorded(device_s, rng, missing, doubled, jitter_s), host, SyncLimits(jitter_s=0.004))
    error_s = worst_error_s(fit, device_s, offset_s, drift_ppm)
    assert error_s < 0.002
    assert error_s < 5 * jitter_s * math.sqrt(2 / 3) * math.sqrt(4 / (0.8 * count)) + 1e-4
    assert error_s <= fit.bound_s * 5 / 4 + 1e-4
    assert fit.inliers >= 0.8 * min(fit.edges)


@SOME
@given(seed=st.integers(0, 10_000), drift_ppm=st.floats(-100, 100), offset_s=st.floats(-1e6, 1e6))
def test_clocks_that_begin_days_apart_are_matched_too(seed: int, drift_ppm: float, offset_s: float) -> None:
    rng = np.random.default_rng(seed)
    host_s = line(80, rng)
    device_s = host_s / (1 + drift_ppm * 1e-6)
    shift_ns = round(offset_s * 1e9)
    fit = fitted(recorded(device_s, rng) + shift_ns, recorded(host_s, rng) + HOST_ZERO_NS, SyncLimits(0.004))
    times = np.round(device_s * 1e9).astype(np.int64)
    assert np.abs(fit.host_ns(times + shift_ns) - HOST_ZERO_NS - host_s * 1e9).max() < 2e6


@SOME
@given(seed=st.integers(0, 10_000))
def test_edges_of_another_run_are_never_matched(seed: int) -> None:
    rng = np.random.default_rng(seed)
    refusal = refused(recorded(line(100, rng), rng), recorded(line(100, rng), rng), SyncLimits(0.004))
    assert refusal.reason == Reason.NO_MATCH


@SOME
@given(seed=st.integers(0, 10_000), period_s=st.floats(0.3, 5.0), count=st.integers(20, 120))
def test_a_periodic_line_is_refused_because_it_fits_at_every_period(seed: int, period_s: float, count: int) -> None:
    rng = np.random.default_rng(seed)
    edges = np.arange(count) * period_s
    refusal = refused(recorded(edges, rng), recorded(edges, rng) + HOST_ZERO_NS, SyncLimits(0.004))
    assert refusal.reason == Reason.AMBIGUOUS


@SOME
@given(seed=st.integers(0, 10_000), offset_s=st.floats(-0.3, 0.3))
def test_a_periodic_line_is_accepted_where_the_offset_is_known_to_half_a_period(seed: int, offset_s: float) -> None:
    rng = np.random.default_rng(seed)
    edges = np.arange(200.0)
    device_s = device_time(edges, offset_s, 50)
    limits = SyncLimits(0.004, max_offset_s=0.4)
    fit = fitted(recorded(device_s, rng), recorded(edges, rng), limits)
    assert abs(fit.offset_s - offset_s - 50e-6 * 100) < 0.006


def test_the_edges_of_a_60_hz_camera_give_2_ms_when_there_are_enough_of_them() -> None:
    """Quantised to 16.7 ms, so 4.8 ms rms; at the ends of 500 edges 2 * 4.8 / sqrt(500) = 0.43 ms rms."""
    rng = np.random.default_rng(5)
    host_s = line(500, rng)
    frames = (np.ceil(device_time(host_s, 0.3, 100) * 60) - 0.5) / 60
    fit = fitted(np.round(frames * 1e9).astype(np.int64), np.round(host_s * 1e9).astype(np.int64) + HOST_ZERO_NS)
    assert worst_error_s(fit, device_time(host_s, 0.3, 100), 0.3, 100) < 0.002
    assert 0.003 < fit.residual_median_s < 0.0055  # of a uniform error of 8.3 ms the median is 4.2 ms
    assert fit.residual_max_s < 0.0084 + fit.bound_s


def test_a_few_edges_with_the_jitter_of_a_camera_do_not_suffice_and_it_says_how_good_they_are() -> None:
    rng = np.random.default_rng(6)
    edges = line(40, rng)
    refusal = refused(recorded(edges, rng, jitter_s=0.0083), recorded(edges, rng, jitter_s=0.0))
    assert refusal.reason == Reason.RESIDUALS
    assert 'ms, but 2 ms are required' in refusal.text


@pytest.mark.parametrize(('device', 'host'), [(0, 100), (7, 100), (100, 7), (1, 1)])
def test_too_few_edges_are_refused(device: int, host: int) -> None:
    edges = recorded(line(100, np.random.default_rng(1)), np.random.default_rng(1), 0, 0)
    refusal = refused(edges[:device], edges[:host])
    assert refusal.reason == Reason.TOO_FEW_EDGES


def test_a_clock_that_drifts_more_than_any_crystal_is_refused() -> None:
    rng = np.random.default_rng(2)
    host_s = line(100, rng)
    device = recorded(device_time(host_s, 0.0, 3000), rng)
    refusal = refused(device, recorded(host_s, rng), SyncLimits(0.004))
    assert refusal.reason == Reason.NO_MATCH


@pytest.mark.parametrize('step_s', [0.01, 0.05, 1.0])
def test_a_clock_that_was_set_in_the_middle_of_the_run_is_refused(step_s: float) -> None:
    rng = np.random.default_rng(3)
    host_s = line(200, rng)
    device_s = host_s + step_s * (np.arange(200) >= 100)
    refusal = refused(recorded(device_s, rng), recorded(host_s, rng), SyncLimits(0.01))
    assert refusal.reason in {Reason.RESIDUALS, Reason.NO_MATCH}


def test_recorders_that_ran_together_for_a_part_only_are_matched_there() -> None:
    rng = np.random.default_rng(4)
    edges = line(300, rng)
    fit = fitted(recorded(edges[:200], rng), recorded(edges[100:], rng) + HOST_ZERO_NS, SyncLimits(0.004))
    assert fit.inliers < 100
    assert worst_error_s(fit, edges[:200], 0.0, 0.0) < 0.002


def test_levels_tell_apart_what_times_alone_do_not() -> None:
    """A square wave of 1 s fits at every half period; with the levels at every whole one, here beyond the limit."""
    edges = np.arange(60) * 500_000_000
    levels = np.arange(60) % 2 == 0
    limits = SyncLimits(0.004, max_offset_s=0.8)
    refused(edges, edges + 100_000_000, limits)
    fit = fitted(edges, edges + 100_000_000, limits, levels, levels)
    assert abs(fit.offset_s - 0.1) < 1e-6


def test_ten_thousand_presses_are_matched() -> None:
    rng = np.random.default_rng(7)
    host_s = line(21_904, rng, 0.5, 1.5)
    device = recorded(device_time(host_s, -0.2, -80), rng)
    fit = fitted(device, recorded(host_s, rng) + HOST_ZERO_NS, SyncLimits(0.004))
    assert abs(fit.drift_ppm + 80) < 0.01
    assert worst_error_s(fit, device / 1e9, -0.2, -80) < 1e-4


def test_a_time_is_carried_over_without_losing_a_digit() -> None:
    none = np.array([], np.int64)
    fit = ClockFit(5_000_000_000, HOST_ZERO_NS, 1.0001, none, none, (0, 0), 0.0, 0.0, 0.0)
    assert fit.host_ns(np.array([15_000_000_000])).tolist() == [HOST_ZERO_NS + 10_001_000_000]
    assert fit.drift_ppm == pytest.approx(100)


def test_one_outlier_does_not_move_the_line() -> None:
    x = np.arange(20.0)
    y = 2 * x
    y[7] += 1
    line = robust_line(x, y)
    assert (line.level, line.slope) == pytest.approx((19, 2), abs=1e-9)
    assert line.inlier.tolist() == [number != 7 for number in range(20)]


def test_points_count_by_the_inverse_square_of_their_uncertainty() -> None:
    """At one x, 1 with half width 1 and 4 with half width 2 weigh 4 to 1: (4 * 1 + 4) / 5 = 1.6."""
    line = robust_line(np.zeros(20), np.tile([1.0, 4.0], 10), np.tile([10.0, 20.0], 10))
    assert line.level == pytest.approx(1.6, rel=0.02)
    assert line.inlier.all()


def test_the_bound_is_four_standard_errors_of_the_line() -> None:
    """Residuals of +-1 at 101 places, -50 to 50: s^2 = 101 / 99, and 1 / 101 + 50^2 / 85850 = 0.03902 at the end."""
    x = np.arange(-50.0, 51.0)
    y = (-1.0) ** np.arange(101)
    bound = robust_line(x, y).bound(x, y, np.array([-50.0, 50.0]), 1e-9)
    assert bound == pytest.approx(4 * math.sqrt(101 / 99 * 0.03902), rel=0.01)


def test_a_straight_line_with_noise_has_no_bend_and_a_step_has() -> None:
    x, noise = np.arange(200.0), np.random.default_rng(1).normal(0, 1, 200)
    assert bend(x, noise) == 0
    assert 3.5 < bend(x, noise + 5 * np.sign(x - 99.5)) < 5.5


@pytest.mark.parametrize(
    ('x', 'y', 'steepest', 'line'),
    [
        ([0.0, 1.0, 2.0], [0.0, 3.0, 2.0], 10.0, (0.0, 1.0)),
        ([0.0, 1.0], [0.0, 3.0], 1.0, (0.0, 1.0)),
        ([5.0], [3.0], 1.0, (3.0, 0.0)),
    ],
    ids=['from below', 'no steeper than allowed', 'level under one point'],
)
def test_the_lower_line_touches_the_cloud(
    x: list[float], y: list[float], steepest: float, line: tuple[float, float]
) -> None:
    assert lower_line(np.array(x), np.array(y), steepest) == pytest.approx(line)


def test_of_a_bouncing_contact_the_first_edge_counts() -> None:
    stamps_ns = np.array([0, 10, 20, 200]) * 1_000_000
    assert without_bounces(stamps_ns, 0.05).tolist() == [0, 3]
    assert without_bounces(stamps_ns, 0.0).tolist() == [0, 1, 2, 3]


def test_matched_edges_are_numbered_as_in_the_lists_that_were_given() -> None:
    rng = np.random.default_rng(8)
    edges = np.round(line(30, rng) * 1e9).astype(np.int64)
    bouncing = np.sort(np.concatenate([edges, edges[5:6] + 8_000_000]))
    fit = fitted(bouncing, edges)
    assert bouncing[fit.device_index].tolist() == edges[fit.host_index].tolist() == edges.tolist()


def test_the_nearest_of_a_list() -> None:
    times = np.array([0.0, 1.0, 2.0])
    assert nearest(times, np.array([-5.0, 0.4, 0.6, 1.4, 9.0])).tolist() == [0, 0, 1, 1, 2]
    assert nearest(times[:1], np.array([7.0])).tolist() == [0]


def test_errors_beyond_what_is_known_of_each_are_found_and_others_are_none() -> None:
    """Errors of 3 that should be of 1: (1 + more²) 0.4 = 9; a uniform error has a mean square of a third."""
    known = np.ones(4)
    assert overlooked(np.array([3.0, -3.0, 3.0, -3.0]), known) == pytest.approx(math.sqrt(21.5), rel=1e-6)
    assert overlooked(np.linspace(-1, 1, 100), np.ones(100)) == 0


def test_edges_that_claim_to_be_known_better_than_they_are_do_not_pull_the_clock_away() -> None:
    """A camera on a network: a sixth of the edges are known to 1 ms within its exposure, but all come 0 to 20 ms late.

    The errors, uniform to 10 ms and for most edges to 12.7 ms more, are 9 ms rms; of 300 edges the line errs by
    2 x 9 / sqrt(300) = 1 ms at its end, four times of which are more than the 2 ms that are asked.
    """
    for seed in range(5):
        rng = np.random.default_rng(seed)
        host_s = line(300, rng)
        half_s = np.where(rng.random(300) < 1 / 6, 0.0012, 0.0127)
        seen_s = host_s + rng.uniform(-1, 1, 300) * half_s + rng.uniform(-0.01, 0.01, 300)
        order = np.argsort(seen_s)
        device_ns, host_ns = (np.round(each * 1e9).astype(np.int64) for each in (seen_s[order], host_s))
        found = refused(device_ns, host_ns, SyncLimits(0.03), None, None, half_s[order], np.full(300, 0.0005))
        assert found.reason == Reason.RESIDUALS
