"""The example of a controller: it opens by itself when it should, and says why."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import pytest
from feeding import START_NS, run

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import types

MS = 1_000_000
OK, DEGRADED, INVALID = 0, 1, 2


@pytest.fixture(scope='module')
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location('grip', Path(__file__).parents[2] / 'examples/grip.py')
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.mark.parametrize(
    ('total_n', 'status', 'age_ms', 'reason'),
    [
        (0.2, OK, 20, ''),
        (0.2, DEGRADED, 20, ''),
        (0.7, OK, 20, 'more than 0.5 N'),
        (0.2, OK, 120, 'the force is old'),
        (0.2, OK, -120, 'the force is stamped in the future: the clock of its machine is ahead'),
        (math.nan, OK, 20, 'more than 0.5 N'),
        (0.2, INVALID, 20, 'the force is invalid'),
    ],
)
def test_it_opens_for_a_force_that_is_too_large_old_or_invalid(
    example: ModuleType, bus: InProcessBus, clock: SteppedClock,
    total_n: float, status: int, age_ms: int, reason: str,
) -> None:  # fmt: skip
    node = example.GripNode(bus, None, clock)
    now_ns = START_NS + 20 * MS
    head = conversions.header(now_ns - age_ms * MS, 'gel_surface')
    topic = topics.FORCE_DISTRIBUTION
    sender = bus.advertise(f'/{topic.name}', topic.type_name, topic.qos)
    sender.publish(types.ForceDistribution(header=head, total=total_n, status=status))
    run(node)
    clock.set_ns(now_ns)
    node.spin_once()
    assert node.reason == reason
    node.close()


def test_it_opens_while_there_is_no_force(example: ModuleType, bus: InProcessBus, clock: SteppedClock) -> None:
    node = example.GripNode(bus, None, clock)
    clock.set_ns(START_NS + 20 * MS)
    node.spin_once()
    assert node.reason == 'there is no force yet'
    node.close()
