"""What every force/torque sensor does, whatever it is: the twin, a Net F/T box, Bota, lines of text."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from ft_rigs import LOAD, RIGS, Rig, assert_counted, lose, read, read_until, rig_of, working

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.force_torque.contract import AXES, Flag, ForceTorqueSettings, Sample
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)

HARDWARE = [kind for kind in RIGS if kind != 'simulated']


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    with rig_of(request.param, tmp_path) as opened:
        yield opened


@pytest.fixture(params=HARDWARE)
def hardware(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    with rig_of(request.param, tmp_path) as opened:
        yield opened


@dataclass
class Session:
    """What was read of a sensor that works: at least 301 samples from its opening on."""

    opened_ns: int
    samples: list[Sample]
    ended_ns: int
    axes: tuple[str, ...]
    rate_hz: float


@pytest.fixture(scope='module', params=RIGS)
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Session:
    clock = SystemClock()
    with rig_of(request.param, tmp_path_factory.mktemp('rig')) as opened:
        sensor, opened_ns = opened.open(), clock.now_ns()
        samples = read(sensor, 301)
        return Session(opened_ns, samples, clock.now_ns(), sensor.axes, sensor.rate_hz)


def test_it_feels_the_load_on_the_axes_that_it_has_and_nothing_on_the_others(session: Session) -> None:
    """The noise is at most 5 mN: the mean of 40 is good to 4 standard errors, 4 mN."""
    for axis, name in enumerate(AXES):
        values = [sample.wrench[axis] for sample in session.samples]
        if name in session.axes:
            assert math.isclose(sum(values) / len(values), LOAD[axis], abs_tol=0.004)
        else:
            assert all(map(math.isnan, values))


def test_stamps_increase_and_are_neither_in_the_future_nor_old(session: Session) -> None:
    assert all(later.stamp_ns > earlier.stamp_ns for earlier, later in itertools.pairwise(session.samples))
    for sample in session.samples:
        assert session.opened_ns - 1e9 < sample.stamp_ns <= sample.arrival_ns <= session.ended_ns


def test_stamps_follow_the_rate_evenly_however_unevenly_samples_arrive(session: Session) -> None:
    """Over 300 periods, within 2 %, which leaves 12 ms of 600 or more for the clock that settles."""
    period_s = (session.samples[300].stamp_ns - session.samples[0].stamp_ns) / 300e9
    assert math.isclose(period_s * session.rate_hz, 1.0, abs_tol=0.02)


def test_every_sample_is_read_once_and_in_order(session: Session) -> None:
    assert [sample.sequence for sample in session.samples] == list(range(len(session.samples)))
    assert session.samples[-1].dropped == 0
    ticks = [sample.device_ticks for sample in session.samples]
    assert all(later > earlier for earlier, later in itertools.pairwise(ticks))


def test_a_sample_that_is_well_is_usable_and_says_its_size(session: Session) -> None:
    size = math.hypot(*(LOAD[axis] for axis in range(3) if AXES[axis] in session.axes))
    for sample in session.samples:
        assert sample.usable
        assert math.isclose(sample.force_n, size, abs_tol=0.05)


def test_a_slow_reader_learns_how_many_samples_it_has_lost(rig: Rig) -> None:
    sensor = rig.open(queue=10)
    last = read(sensor, 1)[-1]
    while (newest := sensor.newest()) is None or newest.sequence < last.sequence + 30:
        SystemClock().sleep_until(SystemClock().now_ns() + 5_000_000)
    late = read(sensor, 1)
    assert len(late) <= 10
    assert late[0].dropped - last.dropped >= 10
    assert_counted([last, *late])


def test_the_newest_sample_is_at_hand_whether_it_was_read_or_not(rig: Rig) -> None:
    sensor = rig.open()
    last = read(sensor)[-1]
    newest = sensor.newest()
    assert newest is not None
    assert newest.sequence >= last.sequence


def test_a_listener_gets_every_sample_that_is_read(rig: Rig) -> None:
    received: list[Sample] = []
    sensor = rig.open()
    sensor.listen(received.append)
    samples = [sample for sample in read(sensor) + read(sensor, 20) if sample.sequence >= received[0].sequence]
    assert samples == received[: len(samples)]


def test_health_and_description_speak_of_a_sensor_that_works(rig: Rig) -> None:
    sensor = rig.open()
    assert 'samples/s' in working(sensor).message
    assert sensor.description['kind']


def test_reading_after_closing_is_an_error_and_closing_twice_is_not(rig: Rig) -> None:
    sensor = rig.open()
    sensor.close()
    sensor.close()
    with pytest.raises(DeviceError, match='open it before reading'):
        sensor.read(0.1)
    assert sensor.health.level == Level.STALE


def test_it_can_be_opened_again_and_counts_from_the_beginning(rig: Rig) -> None:
    sensor = rig.open()
    read(sensor)
    sensor.close()
    sensor.open()
    assert read(sensor, 1)[0].sequence == 0


def test_a_silent_sensor_is_a_timeout_and_never_a_zero(hardware: Rig) -> None:
    sensor, clock = hardware.open(), SystemClock()
    hardware.faults.silent = True
    while 'silent' not in sensor.health.message:
        clock.sleep_until(clock.now_ns() + 5_000_000)
    with pytest.raises(DeviceTimeoutError, match='sent no sample within'):
        while True:
            started_ns = clock.now_ns()
            sensor.read(0.1)
    assert clock.now_ns() - started_ns > 0.09e9
    assert sensor.health.level == Level.ERROR


def test_a_sensor_that_is_lost_says_so_and_comes_back_by_itself(hardware: Rig) -> None:
    sensor = hardware.open()
    before = read(sensor)[-1]
    hardware.take_away()
    before = lose(hardware, sensor, before)
    assert sensor.health.level == Level.ERROR
    hardware.bring_back()
    back = read_until(sensor, lambda sample: True)
    assert back.flags & Flag.RESTARTED
    assert back.dropped > before.dropped
    assert_counted([before, back])
    read_until(sensor, lambda sample: not sample.flags)  # of a machine with other work the sensor may be late at first
    assert sensor.description['times lost'] == '1'


def test_what_is_lost_on_the_way_is_counted(hardware: Rig) -> None:
    sensor = hardware.open()
    read(sensor)
    hardware.faults.lose = 5
    sample = read_until(sensor, lambda sample: sample.dropped > 0)
    assert sample.dropped == 5
    assert sample.usable


def test_a_sensor_at_the_end_of_its_range_gives_no_number_that_can_be_used(hardware: Rig) -> None:
    sensor = hardware.open()
    hardware.faults.saturated = True
    sample = read_until(sensor, lambda sample: bool(sample.flags & Flag.SATURATED))
    assert not sample.usable
    assert sample.force_n == math.inf


@pytest.mark.parametrize('source', ['bota:/dev/no-such-port', 'text:/dev/no-such-port', 'text:///dev/no-such-port'])
def test_a_port_that_is_not_there_is_named(source: str) -> None:
    with pytest.raises(DeviceNotFoundError, match='/dev/no-such-port'):
        open_force_torque(ForceTorqueSettings(source), SystemClock())


@pytest.mark.parametrize('source', ['', 'netft://', 'netft:192.168.1.1:49152', 'bota:', 'hx711:/dev/ttyUSB0'])
def test_a_source_that_names_no_sensor_is_refused_with_an_example(source: str) -> None:
    with pytest.raises(ConfigurationError, match='use '):
        open_force_torque(ForceTorqueSettings(source), SystemClock())


def test_a_baud_rate_that_a_bota_sensor_does_not_have_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match=r'921600 baud; set force_torque\.baud to one of 9600, .*, 460800'):
        open_force_torque(ForceTorqueSettings('bota:/dev/null', baud=921600), SystemClock())


def test_the_twin_can_be_chosen_by_name() -> None:
    sensor = open_force_torque(ForceTorqueSettings('simulated', rate_hz=2000.0), SystemClock())
    assert abs(read(sensor)[0].wrench[2]) < 0.05
