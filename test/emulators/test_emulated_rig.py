"""The whole emulated rig: its faults, its own clocks, and its end."""

from __future__ import annotations

import dataclasses
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.emulators.camera_stream import CameraStream
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.rig import EmulatedRig, EmulatedRigSettings, RigFaults
from tactile_nodes.emulators.world import World
from tactile_nodes.errors import AddressInUseError, ConfigurationError

PORTS = {'rdt_port': 0, 'http_port': 0, 'camera_port': 0}


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[EmulatedRig]:
    made = EmulatedRig(
        EmulatedRigSettings(cnc_port=str(tmp_path / 'cnc'), trace=str(tmp_path / 'trace'), **PORTS), SystemClock()
    )
    yield made
    made.close()


@pytest.fixture
def serial_rig(tmp_path: Path) -> Iterator[EmulatedRig]:
    made = EmulatedRig(EmulatedRigSettings(cnc_port=str(tmp_path / 'cnc'), sensor='bota', **PORTS), SystemClock())
    yield made
    made.close()


def test_serial_line_of_the_sensor_is_pulled_and_plugged_in_again(serial_rig: EmulatedRig, tmp_path: Path) -> None:
    port = tmp_path / 'emulated_ft'
    assert port.exists()
    serial_rig.switch(RigFaults(unplugged_sensor=True))
    assert not port.exists()
    serial_rig.switch(RigFaults())
    assert port.exists()


def test_fault_that_a_sensor_cannot_have_is_refused(rig: EmulatedRig, serial_rig: EmulatedRig) -> None:
    with pytest.raises(ConfigurationError, match='no serial line'):
        rig.switch(RigFaults(unplugged_sensor=True))
    with pytest.raises(ConfigurationError, match='keeps its order'):
        serial_rig.switch(RigFaults(reorder=3))
    assert rig.faults == serial_rig.faults == RigFaults()


def test_rig_is_at_rest_only_when_nobody_commands_it(rig: EmulatedRig, tmp_path: Path) -> None:
    assert rig.rest(30.0)
    port = os.open(tmp_path / 'cnc', os.O_RDWR | os.O_NOCTTY)
    try:
        deadline_s = monotonic_s() + 60.0
        while rig.rest(0.05) and monotonic_s() < deadline_s:
            pass
        assert not rig.rest(0.1)
    finally:
        os.close(port)
    assert rig.rest(60.0)


def test_rig_is_at_rest_only_when_its_motors_are(rig: EmulatedRig) -> None:
    clock = SystemClock()
    arrives_ns = rig.world.go((-50.0, -70.0, -10.0), 10.0, clock.now_ns())
    assert rig.rest(60.0)
    assert clock.now_ns() >= arrives_ns


def test_trace_tells_faults_and_where_the_tip_is(rig: EmulatedRig, tmp_path: Path) -> None:
    rig.switch(RigFaults(silent_camera=True))
    rig.switch(RigFaults())
    deadline_s = monotonic_s() + 60.0
    while 'tip' not in (tmp_path / 'trace').read_text() and monotonic_s() < deadline_s:
        rig.rest(0.01)
    entries = [json.loads(line) for line in (tmp_path / 'trace').read_text().splitlines()]
    assert [each['faults'] for each in entries if 'faults' in each] == [
        {'silent_camera': True},
        {'silent_camera': False},
    ]
    assert next(each['tip'] for each in entries if 'tip' in each) == [-50.0, -70.0, -8.0]


def test_port_that_is_taken_is_reported(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(('127.0.0.1', 0))
        ports = {**PORTS, 'rdt_port': taken.getsockname()[1]}
        with pytest.raises(AddressInUseError, match='another emulated rig'):
            EmulatedRig(EmulatedRigSettings(cnc_port=str(tmp_path / 'cnc'), **ports), SystemClock())


def test_second_rig_leaves_the_first_its_serial_port(tmp_path: Path) -> None:
    settings = EmulatedRigSettings(cnc_port=str(tmp_path / 'cnc'), **PORTS)
    first = EmulatedRig(settings, SystemClock())
    try:
        port = (tmp_path / 'cnc').readlink()
        with pytest.raises(AddressInUseError):
            EmulatedRig(dataclasses.replace(settings, camera_port=first.camera.port), SystemClock())
        assert (tmp_path / 'cnc').readlink() == port
    finally:
        first.close()


@pytest.mark.parametrize('entry', ['cnc_port', 'sensor_port'])
def test_file_that_is_no_link_is_kept_and_named(tmp_path: Path, entry: str) -> None:
    (tmp_path / 'notes').write_text('mine')
    ports = {'cnc_port': str(tmp_path / 'cnc'), entry: str(tmp_path / 'notes')}
    with pytest.raises(ConfigurationError, match='notes'):
        EmulatedRig(EmulatedRigSettings(sensor='bota', **ports, **PORTS), SystemClock())
    assert (tmp_path / 'notes').read_text() == 'mine'


def test_trace_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    trace = str(tmp_path / 'nowhere' / 'trace')
    with pytest.raises(ConfigurationError, match='nowhere/trace'):
        EmulatedRig(EmulatedRigSettings(cnc_port=str(tmp_path / 'cnc'), trace=trace, **PORTS), SystemClock())


def test_clock_that_is_altered_goes_on_counting_and_reads_a_jump() -> None:
    clock = DeviceClock(7000.0)
    altered = clock.altered(2_000_000_000, drift_ppm=1000.0, jump_s=0.3)
    assert altered.count(2_000_000_000) == 14_000
    assert altered.reading(14_000) == 14_000 + 2100
    assert altered.count(3_000_000_000) == 14_000 + 7007  # 1000 ppm of 7000 is 7


class _Stepping:
    """A clock that goes on by 10 ms each time it is read."""

    def __init__(self) -> None:
        self._ns = 0

    def now_ns(self) -> int:
        self._ns += 10_000_000
        return self._ns

    def sleep_until(self, ns: int) -> None:
        self._ns = max(self._ns, ns)


def test_lost_pictures_leave_a_gap() -> None:
    with CameraStream(World(), _Stepping(), fps=20.0) as stream:
        stream.picture = lambda time_ns: b''  # type: ignore[method-assign]
        first_ns, _ = stream.next_picture(0)
        stream.lose = 4
        second_ns, _ = stream.next_picture(first_ns)
    assert 0.25 <= (second_ns - first_ns) / 1e9 < 0.5  # four of 0.05 s are missing
    assert stream.lose == 0
