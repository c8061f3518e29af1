"""The devices of a rig, opened and closed together."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest

from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.collection.hands import InterruptedRunError
from tactile_nodes.collection.safety import MACHINE
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.drivers.cnc.contract import CncSettings, Place
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings, Sample
from tactile_nodes.drivers.health import Health
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import BusError, DeviceError

PATIENCE_S = 60.0
SAFE_Z_MM, LOW_Z_MM = -4.0, -6.0


def nothing(_: object) -> None:
    """Nobody is informed."""


def near(start_mm: Place = (-3.0, -3.0, -1.0), tell: Callable[[Sample], None] = nothing) -> Station:
    """A rig whose end switches and gel are near."""
    world = WorldSettings(start_mm=start_mm, gel_x_mm=-3.0, gel_y_mm=-3.0, gel_z_mm=-9.0)
    settings = CollectionSettings(limits=LimitSettings(force_silence_ms=5000.0))
    machine = CncSettings(safe_z_mm=SAFE_Z_MM)
    return Station(settings, machine, ForceTorqueSettings(), world, SystemClock(), tell, nothing, nothing)


def test_a_sample_that_nobody_can_receive_after_closing_ends_the_pump_quietly() -> None:
    """On a machine without time to spare closing does not wait for the last sample, whose publisher is closed then."""
    published, closed = threading.Event(), threading.Event()

    def tell(_: Sample) -> None:
        published.set()
        closed.wait(PATIENCE_S)
        raise BusError('the publisher of /force_torque is closed')

    station = near(tell=tell)
    assert published.wait(PATIENCE_S)
    station.close()
    closed.set()
    station._pump.join(PATIENCE_S)
    assert not station._pump.is_alive()


def test_a_run_that_takes_longer_than_closing_waits_brings_its_tip_up() -> None:
    """Closing under it would leave the tip down, and dismiss what brings it up without this process."""
    station, low, may_go_up = near(), threading.Event(), threading.Event()

    def run() -> None:
        station.hands.home()
        station.cnc.move(z=LOW_Z_MM, feed=1200.0)
        station.cnc.wait_idle()
        low.set()
        may_go_up.wait(PATIENCE_S)
        station.hands.retreat()

    runner = threading.Thread(target=run)
    runner.start()
    assert low.wait(PATIENCE_S)
    assert not station.close_after(runner, 0.05)
    may_go_up.set()
    runner.join(PATIENCE_S)
    assert station.cnc.status().position_mm[2] == pytest.approx(SAFE_Z_MM, abs=0.01)
    assert station.close_after(runner, 0.05)
    with pytest.raises(DeviceError, match='not connected'):
        station.cnc.status()


@pytest.mark.parametrize('begins', [False, True], ids=['just before it begins', 'on its way'])
def test_homing_ends_at_once_when_the_run_is_asked_to_end(begins: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tip that meets something on its way to the end switches must not go on there for seconds."""
    station, caught, stopped = near((-60.0, -60.0, -1.0)), [], threading.Event()
    home, stop = station.cnc.home, station.cnc.stop

    def home_late() -> None:
        """As a thread that gets no processor until it has been stopped once."""
        assert begins or stopped.wait(PATIENCE_S)
        home()

    def stop_and_tell() -> None:
        stop()
        stopped.set()

    monkeypatch.setattr(station.cnc, 'home', home_late)
    monkeypatch.setattr(station.cnc, 'stop', stop_and_tell)

    def run() -> None:
        try:
            station.hands.home()
        except InterruptedRunError as error:
            caught.append(error)

    def x_mm() -> float:
        assert station.world is not None
        return station.world.motor_at(SystemClock().now_ns())[0]

    runner = threading.Thread(target=run)
    try:
        runner.start()
        deadline_s = monotonic_s() + PATIENCE_S
        while (x_mm() < -59.0 if begins else not station.hands.homing) and monotonic_s() < deadline_s:
            time.sleep(0.01)
        station.stop()
        runner.join(PATIENCE_S)
        assert caught
        assert x_mm() < -10.0  # the switches are at 0
        assert not station.cnc.status().homed
    finally:
        station.close()


def test_a_reason_to_stop_that_comes_during_a_stop_stops_the_machine_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """What moved between the two stops, as a jog just sent, would go on."""
    station, stops, twice = near(), [], threading.Event()

    def stop() -> None:
        stops.append(station.guard.stopped.is_set())
        if len(stops) == 1:
            station.guard.stop()
        else:
            twice.set()

    monkeypatch.setattr(station.cnc, 'stop', stop)
    try:
        station.guard.stop()
        assert twice.wait(PATIENCE_S)
        assert stops == [False, False]
        assert station.guard.stopped.wait(PATIENCE_S)
    finally:
        station.close()


def test_a_bug_in_what_watches_the_rig_stops_it(monkeypatch: pytest.MonkeyPatch) -> None:
    station = near()
    try:
        station.safety.watch(SystemClock().now_ns(), camera=False)

        def broken(_: object) -> Health:
            raise ValueError('no number')

        monkeypatch.setattr(type(station.cnc), 'health', property(broken))
        deadline_s = monotonic_s() + PATIENCE_S
        while station.safety.trip is None and monotonic_s() < deadline_s:
            time.sleep(0.01)
        assert station.safety.trip is not None
        assert station.safety.trip.kind == MACHINE
        assert 'a bug in the monitoring of the rig: ValueError: no number' in station.safety.trip.reason
    finally:
        station.close()
