"""The guarded approach as a node: force comes in by its topic, and how it ended goes out as the program's status."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from feeding import given, run

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.settings import SurfaceSettings
from tactile_nodes.collection.station import LEAVE_S
from tactile_nodes.drivers.cnc.contract import CncSettings
from tactile_nodes.messages import types
from tactile_nodes.nodes.guarded_approach import GuardedApproachNode
from tactile_nodes.nodes.rig import RigNode

PLACES = {
    'world.start_mm': '[-3.0, -3.0, -1.0]',  # near the end switches, so that it takes a second
    'world.gel_x_mm': '-3.0',
    'world.gel_y_mm': '-3.0',
    'world.gel_z_mm': '-6.0',
    'surface.gel_x_mm': '-3.0',
    'surface.gel_y_mm': '-3.0',
    'surface.top_mm': '-5.9',
    'cnc.safe_z_mm': '-4.0',
    'limits.force_silence_ms': '2000.0',
    'force_torque.rate_hz': '500.0',
    'wait_s': '0.5',
}


@contextmanager
def node(bus: InProcessBus) -> Iterator[GuardedApproachNode]:
    made = GuardedApproachNode(bus, given(*(f'{name}:={value}' for name, value in PLACES.items())), SystemClock())
    try:
        yield made
    finally:
        made.close()


def test_without_a_sensor_it_ends_with_a_sentence() -> None:
    with node(InProcessBus(SystemClock())) as tested:
        tested.spin()
        assert str(tested.failure) == 'no valid force within 0.5 s; is the sensor running?'


def test_it_gives_up_on_a_sensor_that_falls_silent_and_goes_up() -> None:
    bus, clock = InProcessBus(SystemClock()), SystemClock()
    with node(bus) as tested:
        topic = topics.FORCE_DISTRIBUTION
        head = conversions.header(clock.now_ns(), 'gel_surface')
        force = types.ForceDistribution(header=head, rows=1, cols=1, normal_force=np.zeros(1, np.float32))
        bus.advertise('/force_distribution', topic.type_name, topic.qos).publish(force)
        run(tested)
        tested.spin()
        assert 'ms old, above 100 ms' in str(tested.failure)
        assert abs(tested._guarded.station.cnc.status().position_mm[2] + 4.0) < 0.01


@pytest.mark.parametrize('node', [RigNode, GuardedApproachNode])
def test_a_process_that_is_asked_to_end_gives_its_tip_the_time_to_come_up(
    node: type[RigNode | GuardedApproachNode],
) -> None:
    """From a gel 25 mm below cnc.safe_z_mm, at cnc.retract_mm_min, before the process is ended by force."""
    cnc = CncSettings()
    deep_mm = cnc.safe_z_mm - SurfaceSettings().top_mm + 1.0
    assert 60 * deep_mm / cnc.retract_mm_min + 0.5 < LEAVE_S
    assert LEAVE_S < node.END_WITHIN_S < 5.0  # a launch sends the next signal after 5 s


def test_asked_to_end_it_ends_without_complaint() -> None:
    with node(InProcessBus(SystemClock())) as tested:
        tested.stop()
        tested._thread.join()
        assert tested.failure is None
