"""The devices of a rig, opened and closed together."""

from __future__ import annotations

import threading

from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.drivers.cnc import CncSettings
from tactile_nodes.drivers.force_torque import ForceTorqueSettings, Sample
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import BusError

PATIENCE_S = 15.0


def test_a_sample_that_nobody_can_be_told_after_closing_ends_the_pump_quietly() -> None:
    """On a machine without time to spare closing does not wait for the last sample, whose publisher is closed then."""
    told, closed = threading.Event(), threading.Event()

    def tell(_: Sample) -> None:
        told.set()
        closed.wait(PATIENCE_S)
        raise BusError('the publisher of /force_torque is closed')

    def nothing(_: object) -> None:
        return None

    station = Station(
        CollectionSettings(),
        CncSettings(),
        ForceTorqueSettings(),
        WorldSettings(),
        SystemClock(),
        tell,
        nothing,
        nothing,
    )
    assert told.wait(PATIENCE_S)
    station.close()
    closed.set()
    station._pump.join(PATIENCE_S)
    assert not station._pump.is_alive()
