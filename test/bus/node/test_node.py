"""A node: callbacks one after the other in one thread, timers by its clock, errors that do not end it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from agents import FullDisk, got, until

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import NodeArguments, parse_arguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.errors import ConfigurationError, DeviceLostError, ServiceError
from tactile_nodes.messages import services, time_from_ns, types
from tactile_nodes.params import parameter

Spin = Callable[[Node], Node]
START_NS = 1_700_000_000 * NS_PER_S


@dataclass(frozen=True)
class Params(NodeParams):
    gain: float = parameter(1.0, 'a gain', minimum=0.0, maximum=10.0)


class Plain(Node):
    NAME = 'plain'
    PARAMS = Params


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock(START_NS)


@pytest.fixture
def bus(clock: SteppedClock) -> Iterator[InProcessBus]:
    made = InProcessBus(clock)
    yield made
    made.close()


@pytest.fixture
def node(bus: InProcessBus, clock: SteppedClock) -> Iterator[Plain]:
    made = Plain(bus, clock=clock)
    yield made
    made.close()


def heard(bus: InProcessBus, topic: topics.Topic) -> Subscription:
    return bus.subscribe(topic.name, topic.type_name, Qos('queue', 10))


def _spin_dry(node: Node) -> None:
    for _ in range(50):
        node.spin_once()


def test_no_timer_acts_once_the_node_was_stopped(node: Plain, clock: SteppedClock) -> None:
    """Else a controller that was just stopped would send one more command."""
    ticks: list[str] = []
    node.create_timer(0.1, lambda: ticks.append('tick'))
    clock.set_ns(clock.now_ns() + NS_PER_S)
    node.post(node.stop)
    _spin_dry(node)
    assert not ticks


def test_timer_ticks_at_its_period_however_late_each_call_is(node: Plain, clock: SteppedClock) -> None:
    ticks: list[float] = []
    node.create_timer(0.1, lambda: ticks.append((clock.now_ns() - START_NS) / NS_PER_S))
    for _ in range(100):
        clock.advance(0.03)  # looked at each 30 ms, so that most ticks are up to 30 ms late
        node.spin_once()
    assert len(ticks) == 30  # 3.0 s at 0.1 s; without making up for lateness it would be 25
    assert ticks[:3] == [0.12, 0.21, 0.3]


def test_timer_skips_the_periods_that_it_missed(node: Plain, clock: SteppedClock) -> None:
    ticks: list[int] = []
    node.create_timer(0.1, lambda: ticks.append(1))
    clock.advance(1.05)
    _spin_dry(node)
    assert len(ticks) == 1
    clock.advance(0.05)
    _spin_dry(node)
    assert len(ticks) == 2


def test_callbacks_run_in_the_thread_that_spins(bus: InProcessBus, spinning: Spin) -> None:
    threads: list[int] = []
    node = spinning(Plain(bus))
    node.create_subscription(topics.WRENCH, lambda received: threads.append(threading.get_ident()))
    node.post(lambda: threads.append(threading.get_ident()))
    until(lambda: threads)
    bus.advertise('/wrench', topics.WRENCH.type_name, topics.WRENCH.qos).publish(types.WrenchStamped())
    until(lambda: len(threads) == 2)
    assert threads[0] == threads[1] != threading.get_ident()


def test_no_message_of_a_queue_is_lost_on_the_way_to_its_callback(bus: InProcessBus, spinning: Spin) -> None:
    seen: list[int] = []
    spinning(Plain(bus)).create_subscription(topics.SYNC_EDGE, lambda received: seen.append(received.message.count))
    publisher = bus.advertise('/sync_edge', topics.SYNC_EDGE.type_name, topics.SYNC_EDGE.qos)
    for number in range(1000):
        publisher.publish(types.SyncEdge(count=number))
    until(lambda: len(seen) == 1000)
    assert seen == list(range(1000))


def test_keep_latest_topic_gives_a_slow_callback_the_newest(node: Plain, bus: InProcessBus) -> None:
    seen: list[int] = []
    node.create_subscription(topics.IMAGE, lambda received: seen.append(received.message.width))
    publisher = bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
    for width in (1, 2, 3):
        publisher.publish(types.Image(width=width))
    _spin_dry(node)
    assert seen == [3]


def test_error_of_ours_in_a_callback_is_reported_and_the_node_goes_on(
    node: Plain, bus: InProcessBus, clock: SteppedClock, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[int] = []

    def fail_once(received: Received) -> None:
        seen.append(1)
        if len(seen) == 1:
            raise DeviceLostError('the camera is gone; plug it in')

    node.create_subscription(topics.IMAGE, fail_once)
    diagnostics = heard(bus, topics.DIAGNOSTICS)
    publisher = bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos)
    for _ in range(2):
        publisher.publish(types.Image())
        _spin_dry(node)
    clock.advance(1.0)
    _spin_dry(node)
    assert got(diagnostics).message.status[0].message == 'the camera is gone; plug it in'
    assert len(seen) == 2
    assert 'the camera is gone' in capsys.readouterr().err


def test_a_full_disk_under_the_log_does_not_end_a_node(
    node: Plain, bus: InProcessBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    logs = heard(bus, topics.ROSOUT)
    monkeypatch.setattr('sys.stderr', FullDisk())
    node.log.warn('the light flickers')
    assert got(logs).message.msg == 'the light flickers'


def test_a_node_that_has_logged_nothing_yet_is_reported_to_run(
    node: Plain, bus: InProcessBus, clock: SteppedClock
) -> None:
    diagnostics = heard(bus, topics.DIAGNOSTICS)
    clock.advance(1.0)
    _spin_dry(node)
    (status,) = got(diagnostics).message.status
    assert (status.name.partition(': ')[2], status.level, status.hardware_id) == ('node', 0, 'none')


@pytest.mark.parametrize('failure', [None, DeviceLostError('the camera is gone')])
def test_a_node_that_ends_as_it_was_asked_to_tells_it(
    node: Plain, bus: InProcessBus, failure: DeviceLostError | None
) -> None:
    diagnostics = heard(bus, topics.DIAGNOSTICS)
    node.failure = failure
    node.close()
    received = diagnostics.take()
    assert (received is None) == (failure is not None)
    if received is not None:
        (status,) = received.message.status
        assert (status.name, status.level, status.message) == ('plain: node', Level.STALE, 'ended')


def test_bug_in_a_callback_is_not_hidden(node: Plain, bus: InProcessBus) -> None:
    node.post(lambda: 1 // 0)  # type: ignore[arg-type,return-value]
    with pytest.raises(ZeroDivisionError):
        node.spin()


@pytest.mark.parametrize(
    ('error', 'failure'),
    [(DeviceLostError('the camera is gone'), 'the camera'), (ValueError('no number'), 'a bug')],
)
def test_what_ends_a_thread_beside_ends_the_node(node: Plain, error: Exception, failure: str) -> None:
    """Else it would go on answering, and nothing would come of what it is there for."""

    def work() -> None:
        raise error

    node.run_beside('reader', work).join()
    node.spin()  # returns
    assert str(node.failure).startswith(failure)
    assert str(error) in str(node.failure)


def test_stopped_node_does_not_work_off_what_still_waits(node: Plain) -> None:
    done: list[int] = []
    for number in range(10):
        node.post(lambda number=number: done.append(number))  # type: ignore[misc]
    node.post(node.stop)
    node.post(lambda: done.append(99))
    node.spin()
    assert 99 not in done


def test_service_answers_from_the_nodes_thread_and_tells_its_errors(bus: InProcessBus, spinning: Spin) -> None:
    node = Plain(bus)

    def answer(request: Any) -> Any:
        if not request.data:
            raise ConfigurationError('only true will do')
        return types.SetBool_Response(success=True)

    node.create_service('~/set', services.SET_BOOL, answer)
    spinning(node)
    assert bus.call('/plain/set', services.SET_BOOL, types.SetBool_Request(data=True)).success
    with pytest.raises(ServiceError, match='only true will do'):
        bus.call('/plain/set', services.SET_BOOL, types.SetBool_Request())


def test_trigger_turns_an_error_into_its_sentence(bus: InProcessBus, spinning: Spin) -> None:
    def act() -> str:
        raise DeviceLostError('no camera')

    node = Plain(bus)
    node.create_trigger('~/tare', act)
    spinning(node)
    answer = bus.call('/plain/tare', services.TRIGGER, types.Trigger_Request())
    assert (answer.success, answer.message) == (False, 'no camera')


def test_closed_node_leaves_nothing_on_the_bus_and_may_be_closed_twice(bus: InProcessBus) -> None:
    node = Plain(bus)
    node.close()
    node.close()
    graph = bus.graph()
    assert (graph.nodes(), graph.publishers(), graph.subscriptions(), graph.services()) == ([], [], [], [])
    node.log.info('still speaks, on the screen')


def test_node_leaves_the_bus_even_when_closing_its_device_fails(bus: InProcessBus) -> None:
    class Failing(Plain):
        def on_close(self) -> None:
            raise DeviceLostError('it is gone already')

    node = Failing(bus)
    with pytest.raises(DeviceLostError):
        node.close()
    assert bus.graph().nodes() == []


def test_subscription_made_by_another_thread_while_messages_come_in_works(bus: InProcessBus, spinning: Spin) -> None:
    node = spinning(Plain(bus))
    publisher = bus.advertise('/n', 'std_msgs/msg/Int64', Qos('latest', 1, latched=True))
    publisher.publish(types.Int64(data=1))
    seen: list[Any] = []
    topic = topics.Topic('n', 'std_msgs/msg/Int64', '', Qos('queue', 10))
    for _ in range(50):
        node.create_subscription(topic, seen.append)
    until(lambda: len(seen) == 50)


def _sim(bus: InProcessBus) -> tuple[Plain, Callable[[float], None]]:
    node = Plain(bus, parse_arguments(['--ros-args', '-p', 'use_sim_time:=true']))
    clock = bus.advertise('/clock', topics.CLOCK.type_name, topics.CLOCK.qos)

    def set_time(seconds: float) -> None:
        clock.publish(types.Clock(clock=time_from_ns(START_NS + round(seconds * NS_PER_S))))
        _spin_dry(node)

    return node, set_time


def test_simulated_time_drives_timers_also_when_it_begins_again(bus: InProcessBus) -> None:
    node, set_time = _sim(bus)
    ticks: list[int] = []
    set_time(100.0)
    node.create_timer(0.5, lambda: ticks.append(node.clock.now_ns()))
    set_time(100.6)
    set_time(0.0)
    assert len(ticks) == 1
    set_time(0.6)
    assert len(ticks) == 2
    node.close()


def test_a_node_tells_how_it_is_also_while_simulated_time_stands_still(bus: InProcessBus, clock: SteppedClock) -> None:
    """As it does while a player is paused; a view takes who says nothing for silent."""
    node, set_time = _sim(bus)
    diagnostics = heard(bus, topics.DIAGNOSTICS)
    for _ in range(30):
        clock.advance(0.1)
        set_time(100.0)
    assert diagnostics.waiting == 3
    node.close()


def test_name_and_namespace_apply_to_everything_a_node_offers(bus: InProcessBus) -> None:
    arguments = parse_arguments(['--ros-args', '-r', '__ns:=/skin', '-r', '__node:=left', '-r', 'wrench:=/force'])
    node = Plain(bus, arguments)
    node.create_publisher(topics.WRENCH)
    node.create_trigger('~/tare', lambda: '')
    graph = bus.graph()
    assert graph.nodes() == ['/skin/left']
    assert '/force' in graph.topics()
    assert '/skin/left/tare' in {end.name for end in graph.services()}
    node.close()


def test_parameter_that_does_not_fit_keeps_a_node_from_starting(bus: InProcessBus) -> None:
    with pytest.raises(ConfigurationError, match="'gain' must be from 0"):
        Plain(bus, parse_arguments(['--ros-args', '-p', 'gain:=11.0']))
    assert isinstance(Plain(bus, NodeArguments()).params, Params)


@pytest.mark.parametrize(('words', 'given'), [(['--ros-args', '-p', 'gain:=1.0'], 1.0), ([], None)])
def test_a_node_knows_which_parameters_were_given(bus: InProcessBus, words: list[str], given: float | None) -> None:
    assert Plain(bus, parse_arguments(words)).given('gain') == given
