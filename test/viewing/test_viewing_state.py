"""What the view counts, from messages and times given by hand."""

from __future__ import annotations

import math

import pytest
from seen import MS, NAN, S, diagnostics, force, log, received

from tactile_nodes.errors import MessageError
from tactile_nodes.messages import types
from tactile_nodes.viewing.measures import Comparison, Histogram, Recent, StampGaps, stage_times
from tactile_nodes.viewing.state import ViewState, complaint, reason_names, silent

# --- stages and rates -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('acquire', 'total', 'transport', 'latency'),
    [
        pytest.param(0.004, 0.015, 0.003, 0.015, id='transport is what is in no stage'),
        pytest.param(NAN, 0.015, 0.007, 0.015, id='a stage that was not measured counts as transport'),
        # Views showed the minutes or days since it was recorded.
        pytest.param(0.004, 200.0, NAN, NAN, id='a bag that is played later has no latency'),
    ],
)
def test_each_stage_has_its_time(acquire: float, total: float, transport: float, latency: float) -> None:
    stages = types.StageTimes(acquire=acquire, flow=0.005, features=0.001, predict=0.002, transport=0.5)
    expected = (acquire, 0.005, 0.001, 0.002, transport, latency)
    assert stage_times(stages, total) == pytest.approx(expected, nan_ok=True)


def test_rates_come_from_arrivals_and_from_stamps() -> None:
    recent = Recent(5.0)
    for number in range(11):  # 10 intervals: stamps 20 ms apart, arrivals 25 ms
        recent.add(number * 25 * MS, number * 20 * MS, (0.0,) * 6)
    assert recent.rates_hz() == pytest.approx((40.0, 50.0))


def test_rates_need_two_frames() -> None:
    recent = Recent(5.0)
    recent.add(0, 0, (0.0,) * 6)
    assert all(math.isnan(rate) for rate in recent.rates_hz())


def test_percentiles_interpolate_between_frames_of_the_window() -> None:
    recent = Recent(1.0)
    recent.add(0, 0, (9.0,) * 6)  # too old when the last one comes
    for number in range(1, 102):
        recent.add(1 * S + number, 0, (number / 1000, NAN, 0.0, 0.0, 0.0, 0.0))
    found = recent.percentiles()
    assert found['acquire'].p50 == pytest.approx(0.051)
    assert found['acquire'].p99 == pytest.approx(0.100)
    assert math.isnan(found['flow'].p50)


def test_the_histogram_is_right_to_half_a_percent() -> None:
    histogram = Histogram()
    for number in range(1, 1001):
        histogram.add(number / 1000)
    histogram.add(NAN)
    found = histogram.percentiles()
    assert histogram.total == 1000
    assert found.p50 == pytest.approx(0.500, rel=0.005)
    assert found.p99 == pytest.approx(0.990, rel=0.005)


def test_durations_beyond_the_histogram_count_at_its_ends() -> None:
    histogram = Histogram()
    histogram.add(-1.0)
    assert histogram.percentiles().p50 == pytest.approx(1e-6, rel=0.01)
    for seconds in [1e6, math.inf] * 50:
        histogram.add(seconds)
    assert histogram.percentiles().p99 == pytest.approx(100, rel=0.02)


# --- drops ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('numbers', 'skipped'),
    [
        pytest.param((*range(12), 13, 14, 18), 4, id='one is missing, then three'),
        pytest.param((*range(20), 20 + 60 * 50), 60 * 50, id='the camera was away for a minute'),
        pytest.param((0, 1, 2, 9), 0, id='too few intervals to know the usual one'),
    ],
)
def test_gaps_in_the_stamps_are_frames_that_were_skipped(numbers: tuple[int, ...], skipped: int) -> None:
    gaps = StampGaps()
    for number in numbers:
        gaps.add(number * 20 * MS, number * 20 * MS + 5 * MS)
    assert gaps.total == skipped


def test_a_stream_that_begins_again_is_no_gap() -> None:
    gaps = StampGaps()
    for arrival, number in enumerate((*range(100, 112), 3, 4)):
        gaps.add(number * 16 * MS, arrival * 16 * MS)
    assert gaps.total == 0


def test_a_recording_of_a_later_day_is_no_gap_and_does_not_change_the_rate() -> None:
    state = ViewState()
    day_ms = 24 * 3600 * 1000
    for number in range(40):  # each recording has 19 intervals of 20 ms
        stamp_ms = 20 * number + (day_ms if number >= 20 else 0)
        state.add_force(received(force(stamp_ms), 20 * number + 5, number + 1))
    shot = state.summary(S)
    assert shot.skipped == 0
    assert shot.stamps_hz == pytest.approx(50.0)


def test_forces_that_did_not_come_are_counted_from_their_numbers() -> None:
    state = ViewState()
    for sequence in (5, 6, 9):
        state.add_force(received(force(sequence), sequence, sequence))
    shot = state.snapshot(10 * MS)
    assert (shot.frames, shot.lost) == (3, 2)


# --- against the truth ------------------------------------------------------------------------------------------


def test_estimate_and_truth_meet_by_their_stamp_in_either_order() -> None:
    comparison = Comparison()
    comparison.add_truth(1, force(0, (1.0, 0, 0, 0)))
    comparison.add_force(1, force(0, (1.5, 0, 0, 0)))
    comparison.add_force(2, force(0, (1.0, 0, 0, 0)))
    assert comparison.scores().pairs == 1
    comparison.add_truth(2, force(0, (1.0, 0, 0, 0)))
    scores = comparison.scores()
    assert scores.pairs == 2
    assert scores.rmse_n == pytest.approx(math.sqrt(0.5**2 / 2))


def test_the_share_of_right_bins_is_over_frames_in_contact() -> None:
    comparison = Comparison()
    right, wrong, nothing = (0.1, 0.9, 0, 0), (0.9, 0.1, 0, 0), (0.0, 0, 0, 0)
    for stamp, bins in enumerate((right, wrong, right, right)):
        comparison.add_truth(stamp, force(0, (0, 1.0, 0, 0), (1, 1)))
        comparison.add_force(stamp, force(0, bins))
    comparison.add_truth(9, force(0, nothing))
    comparison.add_force(9, force(0, wrong))
    scores = comparison.scores()
    assert (scores.pairs, scores.contact_pairs, scores.right_bin_share) == (5, 4, 0.75)


def test_an_estimate_that_calls_itself_invalid_is_not_scored() -> None:
    comparison = Comparison()
    comparison.add_truth(1, force(0, (1.0, 0, 0, 0)))
    comparison.add_force(1, force(0, (9.0, 0, 0, 0), status=types.ForceDistribution.STATUS_INVALID))
    assert comparison.scores().pairs == 0
    assert comparison.last is not None


def test_truths_without_an_estimate_are_forgotten() -> None:
    comparison = Comparison()
    for stamp in range(1000):
        comparison.add_truth(stamp, force(0))
    comparison.add_force(1, force(0))
    assert comparison.scores().pairs == 0
    comparison.add_force(999, force(0))
    assert comparison.scores().pairs == 1


def test_the_snapshot_shows_estimate_and_truth_of_one_instant() -> None:
    state = ViewState()
    state.add_truth(received(force(10, (0, 0.5, 0, 0), (3.0, 4.0)), 11))
    state.add_force(received(force(10, (0, 0.4, 0, 0), (0.0, 0.0)), 20))
    state.add_force(received(force(26, (0, 0.7, 0, 0), (0.0, 0.0)), 36, 2))  # its truth has not come yet
    shot = state.snapshot(40 * MS)
    assert shot.pair is not None
    assert shot.pair.error_n == pytest.approx(-0.1)
    assert shot.pair.distance_mm == pytest.approx(5.0)


def test_a_recording_that_is_played_again_is_shown_from_its_beginning() -> None:
    """Also one of an earlier day, after one of today; a pair that only came a frame late stays behind the newer one."""
    state = ViewState()
    for number, (stamp, arrival) in enumerate(((10, 20), (5000, 5010), (10, 5020), (26, 5036), (10, 5050)), start=1):
        state.add_truth(received(force(stamp, (0, 0.5, 0, 0)), arrival, number))
        state.add_force(received(force(stamp, (0, 0.01 * number, 0, 0)), arrival, number))
        if number == 3:
            assert state.snapshot(arrival * MS).force.total == pytest.approx(0.03)
    assert state.snapshot(5060 * MS).force.total == pytest.approx(0.04)


@pytest.mark.parametrize('truths', [0, 1])
def test_without_truth_and_when_truths_end_the_last_force_is_shown(truths: int) -> None:
    state = ViewState()
    for _ in range(truths):
        state.add_truth(received(force(10), 11))
    state.add_force(received(force(10), 20))
    state.add_force(received(force(2000, (0, 0.4, 0, 0)), 2010, 2))
    shot = state.snapshot(2020 * MS)
    assert shot.pair is None
    assert shot.force.total == pytest.approx(0.4)


# --- the whole --------------------------------------------------------------------------------------------------


def test_latency_is_from_the_capture_to_the_arrival_and_age_from_there_on() -> None:
    state = ViewState()
    state.add_force(received(force(100), 112.5))
    shot = state.snapshot(round(1612.5 * MS))
    assert shot.latencies['end to end'].p50 == pytest.approx(0.0125)
    assert shot.age_s == pytest.approx(1.5)


def test_the_summary_is_of_the_whole_time() -> None:
    state = ViewState(start_ns=0)
    for number in range(601):  # 60 s at 10 Hz, more than the window
        state.add_force(received(force(number * 100), number * 100 + 20, number + 1))
    shot = state.summary(60 * S)
    assert shot.arrivals_hz == pytest.approx(10.0)
    assert shot.latencies['end to end'].p99 == pytest.approx(0.020, rel=0.005)
    assert state.snapshot(60_000 * MS).frames == 601


def test_the_worst_part_of_each_node_is_reported() -> None:
    state = ViewState()
    state.add_diagnostics(
        received(diagnostics(('camera: camera', 2, 'unplugged'), ('camera: picture', 0, 'ok'), ('flow: rest', 0, '')))
    )
    health = {entry.node: (entry.level, entry.text) for entry in state.snapshot(0).health}
    assert health == {'/camera': (2, 'camera: unplugged'), '/flow': (0, '')}


def test_a_part_that_recovers_is_well_again() -> None:
    state = ViewState()
    state.add_diagnostics(received(diagnostics(('camera: camera', 2, 'unplugged'))))
    state.add_diagnostics(received(diagnostics(('camera: camera', 0, '60 fps'))))
    assert state.snapshot(0).health[0].level == 0


def test_an_error_of_before_a_restart_is_not_reported_for_ever() -> None:
    state = ViewState()
    before, after = diagnostics(('estimator: errors', 2, 'no model')), diagnostics(('estimator: force', 0, 'fine'))
    state.add_diagnostics(received(before, 0))
    state.add_diagnostics(received(after, 1000))
    assert state.snapshot(1000 * MS).health[0].level == 2  # the same program may report its parts apart
    state.add_diagnostics(received(after, 5000))
    assert [(entry.level, entry.text) for entry in state.snapshot(5000 * MS).health] == [(0, 'force: fine')]


def test_a_node_that_says_nothing_more_is_silent() -> None:
    state = ViewState()
    state.add_diagnostics(received(diagnostics(('camera: camera', 0, '')), 0))
    assert silent(state.snapshot(3000 * MS).health) == []
    assert [entry.node for entry in silent(state.snapshot(4000 * MS).health)] == ['/camera']


def test_a_node_that_told_that_it_ended_is_not_silent() -> None:
    """A recorder beside a sensor, say."""
    state = ViewState()
    state.add_diagnostics(received(diagnostics(('bag_recorder: bag', 0, 'recording')), 0))
    state.add_diagnostics(received(diagnostics(('bag_recorder: node', 3, 'ended')), 500))
    assert state.snapshot(9000 * MS).health == ()
    state.add_diagnostics(received(diagnostics(('bag_recorder: bag', 0, 'recording')), 9500))  # another one
    assert [each.node for each in state.snapshot(9500 * MS).health] == ['/bag_recorder']


def test_nodes_of_another_namespace_are_left_out() -> None:
    state = ViewState('/left')
    state.add_diagnostics(received(diagnostics(('left/camera: camera', 0, ''), ('right/camera: camera', 2, 'dark'))))
    state.add_log(received(log(40, 'right.camera', 'dark')))
    shot = state.snapshot(0)
    assert [entry.node for entry in shot.health] == ['/left/camera']
    assert shot.logs == ()


def test_warnings_are_kept_and_repetitions_counted() -> None:
    state = ViewState()
    for level, text in ((20, 'fine'), (30, 'dark'), (30, 'dark'), (40, 'lost')):
        state.add_log(received(log(level, 'camera', text)))
    assert state.snapshot(0).logs == ('[WARN] [camera]: dark (x2)', '[ERROR] [camera]: lost')


def test_bins_that_do_not_fill_their_grid_are_refused() -> None:
    state = ViewState()
    for bins in ((), (0.0, 0.0, 0.0)):
        with pytest.raises(MessageError, match=f'{len(bins)} bins, but a grid of 2 x 2'):
            state.add_force(received(force(0, bins)))
    assert state.frames == 0


def test_what_nodes_say_cannot_command_the_terminal() -> None:
    state = ViewState()
    state.add_note('two\nlines \x1b[2J')
    assert state.snapshot(0).logs == ('two lines  [2J',)


def test_reasons_have_names() -> None:
    kind = types.ForceDistribution
    assert reason_names(kind.REASON_DARK_IMAGE | kind.REASON_STALE) == ['dark image', 'stale']
    assert reason_names(0) == []


def test_a_force_of_the_namespace_itself_ends_the_view_of_other_sensors() -> None:
    """A launch with its view, beside a hand that runs: the hand is found first, as the launch is still starting."""
    state = ViewState()
    for name in ('/left', '/right'):
        state.add_sensor(name, 0).add_force(received(force(0)))
    assert len(state.snapshot(0).sensors) == 2
    state.add_force(received(force(0)))
    assert state.snapshot(0).sensors == state.summary(0).sensors == ()


def test_a_node_that_was_silent_long_before_the_forces_ended_is_not_named_as_the_cause() -> None:
    """A recorder that ended an hour ago with an error, say."""
    state = ViewState()
    state.add_diagnostics(received(diagnostics(('bag_recorder: bag', 2, 'the disk is full')), 0))
    state.add_force(received(force(3600_000), 3600_000))
    state.add_diagnostics(received(diagnostics(('camera: camera', 1, 'lost')), 3600_000))
    assert complaint(state.snapshot(3605 * S)) == '/camera: camera: lost'
    state.add_diagnostics(received(diagnostics(('bag_recorder: bag', 2, 'the disk is full')), 3604_000))
    assert complaint(state.snapshot(3605 * S)) == '/bag_recorder: bag: the disk is full'
