"""The driver of the Net F/T box on the emulated box: starting, renewing, and what goes wrong."""

from __future__ import annotations

import contextlib
import errno
import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from ft_rigs import LOAD, Rig, assert_counted, lose, net_ft_rig, read, read_until, working

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.force_torque import net_ft_rdt as rdt
from tactile_nodes.drivers.force_torque.check import SampleCheck
from tactile_nodes.drivers.force_torque.contract import (
    Flag,
    ForceTorqueSensor,
    ForceTorqueSettings,
    NetFtSettings,
    Sample,
)
from tactile_nodes.drivers.force_torque.net_ft import NetFtConnection
from tactile_nodes.drivers.force_torque.opening import open_force_torque
from tactile_nodes.drivers.force_torque.queue import SampleQueue
from tactile_nodes.drivers.health import Level
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)

Make = Callable[..., Rig]


@pytest.fixture
def rig_with(tmp_path: Path) -> Iterator[Make]:
    """Makes a rig with a configuration of the box and settings of the driver."""
    with contextlib.ExitStack() as stack:

        def make(config: NetFtConfig | None = None, **net_ft: object) -> Rig:
            rig = stack.enter_context(net_ft_rig(tmp_path, config, **net_ft))
            stack.callback(lambda: [sensor.close() for sensor in rig.opened])
            return rig

        yield make


def wait_for(condition: Callable[[], bool], within_s: float = 60.0) -> None:
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_the_driver_asks_for_a_finite_count_stops_the_box_when_it_closes_and_changes_nothing(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open(rate_hz=1000.0)
    box = rig.device.box
    assert box.requests[0] == (rdt.START_REALTIME, 5000)  # 10 s at 500 Hz
    sensor.close()
    wait_for(lambda: box.requests[-1][0] == rdt.STOP and box.client is None)
    assert rig.device.refused == []
    assert {command for command, _ in box.requests} == {rdt.START_REALTIME, rdt.STOP}


def test_the_request_is_renewed_without_losing_a_record(rig_with: Make) -> None:
    rig = rig_with(renew_s=0.2, count_s=60.0)
    sensor = rig.open()
    samples = read(sensor)
    while sum(command == rdt.START_REALTIME for command, _ in rig.device.box.requests) < 4:
        samples += read(sensor)
    samples += read(sensor)
    assert samples[-1].dropped == 0
    assert_counted(samples)


def test_the_box_stops_by_itself_when_the_host_dies(rig_with: Make) -> None:
    rig = rig_with()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.sendto(rdt.request(rdt.START_REALTIME, 20), ('127.0.0.1', rig.device.rdt_port))
        host.settimeout(30.0)
        assert rdt.record_in(host.recv(64))
    wait_for(lambda: rig.device.box.client is None)


def test_a_start_that_gets_lost_is_repeated_until_records_come(rig_with: Make) -> None:
    rig = rig_with(renew_s=60.0, count_s=120.0)
    rig.faults.silent = True
    opened: list[ForceTorqueSensor] = []
    opening = threading.Thread(target=lambda: opened.append(rig.open()))
    opening.start()
    wait_for(lambda: len(rig.device.box.requests) > 2)
    rig.bring_back()
    opening.join()
    read(opened[0], 5)
    requests = list(rig.device.box.requests)
    assert {command for command, _ in requests} == {rdt.START_REALTIME}
    read(opened[0], 100)
    assert rig.device.box.requests == requests


def test_a_box_that_never_starts_is_a_timeout_with_advice(rig_with: Make) -> None:
    rig = rig_with(start_tries=2)
    rig.faults.silent = True
    with pytest.raises(DeviceTimeoutError, match='firewall'):
        rig.open()


def test_nobody_at_the_address_is_a_sentence_not_a_hang() -> None:
    with socket.socket() as unused:
        unused.bind(('127.0.0.1', 0))
        port = unused.getsockname()[1]
        settings = ForceTorqueSettings('netft://127.0.0.1', net_ft=NetFtSettings(http_port=port))
        with pytest.raises(DeviceNotFoundError, match='check its address, power and cable'):
            open_force_torque(settings, SystemClock())


@pytest.mark.parametrize('host', ['192.168.1..1', '192.168.1.1 1', '192.168.1.1:49152', 'box/1'])
def test_an_address_with_a_typing_error_is_refused_in_a_sentence(host: str) -> None:
    with pytest.raises(ConfigurationError, match='is not an address of a Net F/T box'):
        open_force_torque(ForceTorqueSettings(f'netft://{host}'), SystemClock())


def test_a_box_with_rdt_switched_off_is_refused(rig_with: Make) -> None:
    with pytest.raises(DeviceError, match='RDT is disabled'):
        rig_with(NetFtConfig(rdt_enabled=False)).open()


@pytest.mark.parametrize(
    'config',
    [
        NetFtConfig(divider=14, counts_per_force=3200, counts_per_torque=64_000),
        NetFtConfig(divider=14, counts_per_force=44_482, counts_per_torque=885_100, axia=True),
    ],
)
def test_counts_per_unit_are_the_boxs_own(rig_with: Make, config: NetFtConfig) -> None:
    samples = read(rig_with(config).open(), 60)
    for axis, expected in enumerate(LOAD):
        mean = sum(sample.wrench[axis] for sample in samples) / len(samples)
        assert mean == pytest.approx(expected, abs=0.003)


def test_the_raw_counts_are_kept(rig_with: Make) -> None:
    sample = read(rig_with().open(), 1)[0]
    assert all(isinstance(count, int) for count in sample.raw)
    assert sample.wrench == pytest.approx([count * 1e-6 for count in sample.raw])


def test_doubled_late_and_malformed_datagrams_are_counted_and_spoil_nothing(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open()
    read(sensor, 10)
    rig.faults.duplicate, rig.faults.swap, rig.faults.malformed = 3, 2, 4
    wait_for(lambda: not (rig.faults.duplicate or rig.faults.swap or rig.faults.malformed))
    samples, lost = read(sensor), 4 + 2  # the malformed, and those that came too late
    while samples[-1].dropped < lost:
        samples += read(sensor)
    assert_counted(samples)
    assert samples[-1].dropped == lost
    assert sensor.description['records lost, doubled, late, malformed'] == '6, 3, 2, 4'


def test_random_loss_is_counted_to_the_last_record(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open()
    rig.faults.loss_rate = 0.05
    samples = read(sensor, 300)
    while samples[-1].dropped < 10:
        samples += read(sensor)
    assert_counted(samples)
    steps = [(b.device_ticks - a.device_ticks) / (b.sequence - a.sequence) for a, b in itertools.pairwise(samples)]
    # A start that is repeated begins a stream anew, at another internal sample.
    assert sum(step != 14 for step in steps) < len(rig.device.box.requests)


def test_a_stalled_front_end_is_no_measurement(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open()
    rig.faults.stalled = True
    sample = read_until(sensor, lambda sample: bool(sample.flags & Flag.STALLED))
    assert not sample.usable
    read_until(sensor, lambda _: 'stalled' in sensor.health.message)
    rig.faults.stalled = False
    assert read_until(sensor, lambda sample: sample.usable).flags == 0


def test_a_fault_of_the_box_is_passed_on_with_its_status(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open()
    rig.faults.status = 1 << 28
    sample = read_until(sensor, lambda sample: bool(sample.flags & Flag.FAULT))
    assert sample.status == 0x9000_0000


def test_a_threshold_in_the_box_is_seen_and_is_no_fault(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open()
    read_until(sensor, lambda sample: not sample.flags)
    rig.faults.status = 1 << 16
    sample = read_until(sensor, lambda sample: bool(sample.flags & Flag.THRESHOLD))
    assert sample.usable
    working(sensor, Level.WARN)


def test_another_client_takes_the_stream_and_the_first_falls_silent(rig_with: Make) -> None:
    rig = rig_with()
    first = rig.open()
    second = rig.open()
    read(second)
    with pytest.raises(DeviceTimeoutError):
        while True:
            first.read(0.1)


def test_a_box_that_was_restarted_is_found_again_with_a_clock_that_begins_anew(rig_with: Make) -> None:
    rig = rig_with()
    sensor, box = rig.open(), rig.device.box
    before = read(sensor)[-1]
    rig.faults.silent = True
    before = lose(rig, sensor, before)
    box.clock = replace(box.clock, start_ns=SystemClock().now_ns(), offset=0)
    box.request(rdt.request(rdt.STOP), ('127.0.0.1', 9), 0)
    rig.faults.silent = False
    after = read_until(sensor, lambda sample: bool(sample.flags & Flag.RESTARTED))
    assert after.device_ticks <= box.clock.count(SystemClock().now_ns())
    assert after.stamp_ns > before.stamp_ns


def test_a_box_that_is_back_before_it_counts_as_lost_is_opened_again_as_its_units_may_be_others(
    rig_with: Make,
) -> None:
    rig = rig_with()
    box, queue = rig.device.box, SampleQueue('box', 5000, SampleCheck())
    with contextlib.closing(NetFtConnection('127.0.0.1', rig.settings, SystemClock())) as connection:
        while queue.newest is None or not 3500 < queue.newest.device_ticks % 2**32 < 2**31:
            connection.fetch(queue)  # until half a second after it wrapped
        begins_anew = (queue.newest.device_ticks - 70_000) % 2**32  # smaller for ten seconds, however late it is read
        box.clock = replace(box.clock, start_ns=SystemClock().now_ns(), offset=begins_anew)
        connection._request()
        with pytest.raises(DeviceLostError, match='has restarted'):
            for _ in range(2000):
                connection.fetch(queue)


def test_a_network_that_goes_down_and_comes_back_is_no_end_of_the_sensor(rig_with: Make) -> None:
    """As when the cable of the adapter is pulled: an error of the socket is neither silence nor a refusal."""
    sensor = rig_with().open()
    connection = sensor._source.connection  # type: ignore[attr-defined]
    socket_of_the_system, failed = connection._socket, threading.Event()

    class Down:
        def __getattr__(self, name: str) -> object:
            return getattr(socket_of_the_system, name)

        def recvfrom(self, _: int) -> tuple[bytes, tuple[str, int]]:
            failed.set()
            raise OSError(errno.ENETDOWN, 'Network is down')

    connection._socket = Down()
    assert failed.wait(30.0)
    assert read_until(sensor, lambda sample: bool(sample.flags & Flag.RESTARTED)).usable
    assert sensor.description['times lost'] == '1'


def test_stamps_are_those_of_the_boxs_own_clock(rig_with: Make) -> None:
    """The emulator knows when it measured. A record that arrives late is not stamped later than those before it."""
    rig = rig_with()
    sensor, clock = rig.open(), rig.device.box.clock

    def is_timed(samples: list[Sample]) -> bool:
        late_ns = [sample.stamp_ns - clock.time_ns((sample.device_ticks - clock.offset) % 2**32) for sample in samples]
        grow_ns = max(after - before for before, after in itertools.pairwise(late_ns))
        return 0 <= min(late_ns) <= max(late_ns) < 3e6 and grow_ns < 1e5

    assert any(is_timed(read(sensor, 200)) for _ in range(50))  # once the emulator gets a processor in time


def test_another_rate_than_the_one_asked_for_is_a_warning(rig_with: Make) -> None:
    rig = rig_with()
    sensor = rig.open(rate_hz=1000.0)
    assert '1000 samples/s were requested, but the box sends 500' in working(sensor, Level.WARN).message


@pytest.mark.parametrize(('axia', 'requested_hz'), [(False, 150.0), (True, 350.0)])
def test_the_rate_is_set_on_request_and_rounded_up_by_the_box(
    rig_with: Make, monkeypatch: pytest.MonkeyPatch, axia: bool, requested_hz: float
) -> None:
    rig = rig_with(NetFtConfig(axia=axia), set_rate=True)
    box = rig.device.box

    def change(target: str) -> tuple[int, bytes]:
        name, _, hz = target.removeprefix('/comm.cgi?').partition('=')
        assert name == box.config.rate_field
        box.config = replace(box.config, divider=7000 // int(hz))
        return 200, b'<html><body>saved</body></html>'

    monkeypatch.setattr(rig.device, 'change', change)
    sensor = rig.open(rate_hz=requested_hz)
    working(sensor)
    assert sensor.rate_hz == pytest.approx({150.0: 7000 / 46, 350.0: 350.0}[requested_hz])


def test_every_record_at_the_highest_rate(rig_with: Make) -> None:
    rig = rig_with(NetFtConfig(divider=1))
    samples: list[Sample] = read(rig.open(), 4000)
    assert samples[-1].dropped == 0
    assert_counted(samples)
