"""The node that publishes the edges of the line: from a simulated rig's world, by a clock of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest
from coarse_table import linear_table

from tactile_nodes import params
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import NS_PER_S, SystemClock, monotonic_s
from tactile_nodes.collection.station import WORLD
from tactile_nodes.emulators.clocks import ForeignClock
from tactile_nodes.emulators.world import World
from tactile_nodes.errors import DeviceNotFoundError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.nodes.sync_input import SyncInputNode
from tactile_nodes.simulation import worlds
from tactile_nodes.simulation.gel import Gel

MS = 1_000_000
PATIENCE_S = 10.0


@pytest.fixture
def real_bus() -> Iterator[InProcessBus]:
    made = InProcessBus(SystemClock())
    yield made
    made.close()


def made_node(bus: InProcessBus, text: str) -> SyncInputNode:
    block = f'sync_input:\n  ros__parameters: {text}\n'
    return SyncInputNode(bus, NodeArguments(parameters=params.parse_parameters(block, 'the test')))


@pytest.fixture
def spun(real_bus: InProcessBus) -> Iterator[Callable[[str], SyncInputNode]]:
    nodes: list[SyncInputNode] = []
    threads: list[threading.Thread] = []

    def start(text: str) -> SyncInputNode:
        nodes.append(made_node(real_bus, text))
        threads.append(threading.Thread(target=nodes[-1].spin))
        threads[-1].start()
        return nodes[-1]

    yield start
    for node, thread in zip(nodes, threads, strict=True):
        node.stop()
        thread.join()
        node.close()


@pytest.fixture
def world() -> Iterator[World]:
    made = World(table=linear_table(Gel()))
    worlds.share(WORLD, made)
    yield made
    worlds.share(WORLD, World(table=linear_table(Gel())))


@pytest.mark.parametrize('simulated_time', ['false', 'true'])  # without a /clock
def test_edges_of_the_worlds_line_are_reported_by_the_recorders_own_clock(
    real_bus: InProcessBus, spun: Callable[[str], SyncInputNode], world: World, simulated_time: str
) -> None:
    subscription = real_bus.subscribe('/sync_edge', topics.SYNC_EDGE.type_name, Qos('queue', 100))
    clock = SystemClock()
    spun(
        f'{{device: simulated, recorder: other_computer, emulated: {{ahead_s: 10.0}}, use_sim_time: {simulated_time}}}'
    )
    switched_ns = []
    edges: list[types.SyncEdge] = []
    for level in (True, False):
        switched_ns.append(clock.now_ns())
        world.set_line(level, switched_ns[-1])
        received = subscription.get(PATIENCE_S)
        assert received is not None
        edges.append(received.message)
    assert [(edge.level, edge.count, edge.header.frame_id) for edge in edges] == [
        (True, 1, 'other_computer'),
        (False, 2, 'other_computer'),
    ]
    for edge, time_ns in zip(edges, switched_ns, strict=True):
        off_ns = abs(stamp_ns(edge.header.stamp) - time_ns - 10 * NS_PER_S)
        assert off_ns <= edge.uncertainty * NS_PER_S + 5 * MS
        assert 0 < edge.uncertainty < 0.5


def test_without_a_device_nothing_is_watched_and_nothing_fails(
    spun: Callable[[str], SyncInputNode], world: World
) -> None:
    node = spun('{}')
    deadline_s = monotonic_s() + PATIENCE_S
    while not node.spinning:
        assert monotonic_s() < deadline_s
    assert node.failure is None


def test_a_port_that_is_not_there_is_reported_at_the_start(real_bus: InProcessBus) -> None:
    with pytest.raises(DeviceNotFoundError, match='/dev/no-such-port'):
        made_node(real_bus, '{device: /dev/no-such-port}')


def test_a_foreign_clock_is_ahead_and_drifts() -> None:
    """A million seconds at +100 ppm are 100 s too many."""

    class Given:
        time_ns = 5 * NS_PER_S

        def now_ns(self) -> int:
            return self.time_ns

        def sleep_until(self, deadline_ns: int) -> None:
            self.time_ns = deadline_ns

    host = Given()
    clock = ForeignClock(host, ahead_s=0.3, drift_ppm=100.0)
    assert clock.now_ns() == 5_300_000_000
    host.time_ns += 1_000_000 * NS_PER_S
    assert clock.now_ns() == pytest.approx(1_000_105_300_000_000, abs=1000)
    clock.sleep_until(clock.now_ns() + NS_PER_S)
    assert host.time_ns == pytest.approx((1_000_005 + 1 / 1.0001) * NS_PER_S, abs=1000)
