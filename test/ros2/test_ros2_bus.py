"""What the ROS 2 bus promises: the same as the others, and what a ROS 2 user expects besides.

Against the real rclpy where there is one, else against the emulator beside this file.
"""

from __future__ import annotations

import importlib
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from ros2_here import HAS_ROS

from tactile_nodes import messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.ros2.ends import receiving
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import SystemClock
from tactile_nodes.errors import BusError, ConfigurationError, ServiceTimeoutError, ServiceUnavailableError
from tactile_nodes.messages import services, types

NUMBER = 'std_msgs/msg/Int64'
QUEUE = Qos('queue', 1000)
LATCHED = Qos('latest', 1, latched=True)

Join = Callable[[], Any]
Until = Callable[[Callable[[], Any]], Any]


def _number(value: int) -> types.Int64:
    return types.Int64(data=value)


def _connected(publisher: Any, until: Until) -> Any:
    until(lambda: publisher.listeners)
    return publisher


def _next(subscription: Subscription) -> Received:
    received = subscription.get(10.0)
    assert received is not None
    return received


def _taken(subscription: Subscription, count: int) -> list[int]:
    return [_next(subscription).message.data for _ in range(count)]


def _trigger(bus: Any, name: str, timeout_s: float = 20.0) -> Any:
    return bus.call(name, services.TRIGGER, types.Trigger_Request(), timeout_s)


def _heard(subscription: Subscription, publisher: Any, message: Any, until: Until) -> Any:
    """What is published again and again, because what is sent once as best effort may be lost on a busy machine."""
    received = until(lambda: publisher.publish(message) or subscription.get(0.2))
    return received.message


def test_message_travels_as_the_bytes_of_our_codec(join: Join, until: Until) -> None:
    here, there = join(), join()
    subscription = here.subscribe('/image', 'sensor_msgs/msg/Image', QUEUE)
    publisher = _connected(there.advertise('/image', 'sensor_msgs/msg/Image', QUEUE), until)
    message = types.Image(height=2, width=3, step=3, encoding='mono8', data=np.arange(6, dtype=np.uint8))
    data = messages.encode(message)
    publisher.publish(message)
    publisher.publish_bytes(data)
    first, second = _next(subscription), _next(subscription)
    assert (first.data[: len(data)], second.data[: len(data)]) == (data, data)
    assert first.message.data.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.skipif(HAS_ROS, reason='needs an rclpy like that of Humble')
def test_callbacks_that_get_the_message_alone_as_in_humble_do(
    join: Join, until: Until, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(importlib.import_module('rclpy.subscription').Subscription, 'CallbackType')
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    _connected(bus.advertise('/n', NUMBER, QUEUE), until).publish(_number(7))
    received = _next(subscription)
    assert (received.message.data, received.source_ns) == (7, received.received_ns)


def test_subscriber_of_the_same_process_gets_it_too_stamped_on_the_time_base_of_the_host(
    join: Join, until: Until
) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = _connected(bus.advertise('/n', NUMBER, QUEUE), until)
    before_ns = bus.clock.now_ns()
    publisher.publish(_number(1))
    received = _next(subscription)
    assert received.message.data == 1
    assert before_ns - 5_000_000 <= received.source_ns <= received.received_ns + 5_000_000
    assert received.received_ns <= bus.clock.now_ns()


def test_keep_latest_keeps_the_newest_and_counts_what_gave_way(join: Join, until: Until) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, Qos('latest', 1))
    publisher = _connected(bus.advertise('/n', NUMBER, QUEUE), until)
    for number in range(1, 4):
        publisher.publish(_number(number))
        until(lambda number=number: subscription.received >= number)
    assert (subscription.dropped, _taken(subscription, 1)) == (2, [3])


def test_latched_message_is_given_to_who_comes_late(join: Join, until: Until) -> None:
    bus = join()
    publisher = bus.advertise('/n', NUMBER, LATCHED)
    publisher.publish(_number(1))
    publisher.publish(_number(2))
    late = join().subscribe('/n', NUMBER, LATCHED)
    assert _taken(late, 1) == [2]


def test_latched_message_is_also_given_to_who_did_not_ask_for_latched_ones(join: Join, until: Until) -> None:
    bus = join()
    publisher = bus.advertise('/n', NUMBER, LATCHED)
    publisher.publish(_number(1))
    recorder = join()
    until(lambda: recorder.graph().publishers('/n'))
    assert _taken(recorder.subscribe('/n', NUMBER, QUEUE), 1) == [1]


def test_best_effort_publisher_that_is_there_is_heard(join: Join, until: Until) -> None:
    bus, other = join(), join()
    publisher = bus.advertise('/n', NUMBER, Qos('latest', 1, reliable=False))
    until(lambda: other.graph().publishers('/n'))
    subscription = other.subscribe('/n', NUMBER, QUEUE)
    assert _heard(subscription, _connected(publisher, until), _number(4), until).data == 4


def test_clock_is_heard_from_a_player_that_publishes_best_effort(join: Join, until: Until) -> None:
    bus = join()
    topic = topics.CLOCK
    subscription = bus.subscribe(topic.name, topic.type_name, topic.qos)  # before the player is there
    publisher = join().advertise(topic.name, topic.type_name, Qos('latest', 1, reliable=False))
    clock = types.Clock(clock=types.Time(sec=5))
    assert _heard(subscription, _connected(publisher, until), clock, until).clock.sec == 5


def test_what_nodes_said_is_kept_for_who_looks_later(join: Join, until: Until) -> None:
    bus = join()
    topic = topics.ROSOUT
    bus.advertise(topic.name, topic.type_name, topic.qos).publish(types.Log(msg='hello'))
    looker = join()
    until(lambda: looker.graph().publishers(topic.name))
    assert _next(looker.subscribe(topic.name, topic.type_name, QUEUE)).message.msg == 'hello'


def test_clock_that_was_set_after_the_boot_is_warned_of(
    join: Join, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    join().close()
    monkeypatch.setattr('tactile_nodes.bus.ros2.graph_bus.wall_ns', lambda: SystemClock().now_ns() - 3_000_000_000)
    join()
    assert 'stamps of this package are +3.000 s from the wall clock' in capfd.readouterr().err


def test_closed_ends_are_not_kept(join: Join) -> None:
    bus = join()
    for _ in range(5):
        bus.subscribe('/n', NUMBER, QUEUE).close()
        bus.advertise('/n', NUMBER, QUEUE).close()
        bus.serve('/s', services.TRIGGER, lambda request, reply: None).close()
    assert len(bus._ends) <= 2


def test_closing_a_bus_wakes_who_waits_for_a_message(join: Join) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    got: list[Any] = []
    thread = threading.Thread(target=lambda: got.append(subscription.get(30.0)))
    thread.start()
    bus.close()
    thread.join(10.0)
    assert got == [None]


# --- services ---------------------------------------------------------------------------------------------------


def test_service_of_another_process_is_called(join: Join) -> None:
    join().serve('/s', services.SET_BOOL, lambda request, reply: reply(types.SetBool_Response(success=request.data)))
    assert join().call('/s', services.SET_BOOL, types.SetBool_Request(data=True)).success


def test_service_may_answer_later_while_messages_go_on(join: Join, until: Until) -> None:
    bus, caller = join(), join()
    waiting: list[Any] = []
    bus.serve('/s', services.TRIGGER, lambda request, reply: waiting.append(reply))
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = _connected(caller.advertise('/n', NUMBER, QUEUE), until)
    answers: list[Any] = []
    thread = threading.Thread(target=lambda: answers.append(_trigger(caller, '/s')))
    thread.start()
    until(lambda: waiting)
    publisher.publish(_number(3))
    assert _taken(subscription, 1) == [3]
    waiting[0](types.Trigger_Response(success=True, message='later'))
    thread.join(20.0)
    assert answers[0].message == 'later'


def test_two_calls_wait_for_their_answers_at_the_same_time(join: Join, until: Until) -> None:
    bus, caller = join(), join()
    waiting: list[Any] = []
    bus.serve('/s', services.TRIGGER, lambda request, reply: waiting.append(reply))
    answers: list[str] = []

    def ask() -> None:
        answers.append(_trigger(caller, '/s').message)

    threads = [threading.Thread(target=ask) for _ in range(2)]
    for thread in threads:
        thread.start()
    until(lambda: len(waiting) == 2)
    for number, reply in enumerate(waiting):
        reply(types.Trigger_Response(message=str(number)))
    for thread in threads:
        thread.join(20.0)
    assert sorted(answers) == ['0', '1']


@pytest.mark.parametrize('later', [False, True])
def test_refusal_of_a_trigger_is_its_message(join: Join, later: bool) -> None:
    def refuse(request: Any, reply: Any) -> None:
        del request
        if not later:
            raise ConfigurationError('no rest image yet')
        reply(ConfigurationError('no rest image yet'))

    join().serve('/s', services.TRIGGER, refuse)
    response = _trigger(join(), '/s')
    assert (response.success, response.message) == (False, 'no rest image yet')


def test_refused_parameters_each_get_the_reason(join: Join) -> None:
    join().serve('/s', services.SET_PARAMETERS, lambda request, reply: reply(ConfigurationError('no such file')))
    request = types.SetParameters_Request(parameters=[types.Parameter(name='a'), types.Parameter(name='b')])
    results = join().call('/s', services.SET_PARAMETERS, request).results
    assert [(result.successful, result.reason) for result in results] == [(False, 'no such file')] * 2


def test_bug_in_a_handler_neither_ends_receiving_nor_leaves_the_caller_waiting(
    join: Join, capfd: pytest.CaptureFixture[str]
) -> None:
    bus = join()
    bus.serve('/bad', services.TRIGGER, lambda request, reply: 1 / 0)
    bus.serve('/good', services.TRIGGER, lambda request, reply: reply(types.Trigger_Response(success=True)))
    caller = join()
    assert 'the service failed because of a bug' in _trigger(caller, '/bad').message
    assert _trigger(caller, '/good').success
    assert 'ZeroDivisionError' in capfd.readouterr().err


def test_call_of_nobody_says_how_to_look_for_services(join: Join) -> None:
    with pytest.raises(ServiceUnavailableError, match=r'no node offers the service /s; .*tactile service list'):
        _trigger(join(), '/s', 0.5)


def test_call_without_an_answer_ends_after_its_timeout(join: Join) -> None:
    join().serve('/s', services.TRIGGER, lambda request, reply: None)
    with pytest.raises(ServiceTimeoutError, match=r'no response from /s within 1 s'):
        _trigger(join(), '/s', 1.0)


def test_service_is_served_once_and_again_after_it_was_closed(join: Join) -> None:
    bus = join()
    first = bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/a')
    with pytest.raises(BusError, match='/s is already offered by /a'):
        bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/b')
    first.close()
    bus.serve('/s', services.TRIGGER, lambda request, reply: reply(types.Trigger_Response(message='b')), '/b')
    assert _trigger(join(), '/s').message == 'b'


# --- the graph --------------------------------------------------------------------------------------------------


def test_graph_shows_nodes_and_what_they_offer_while_they_last(join: Join, until: Until) -> None:
    bus, looker = join(), join()
    bus.add_node('/skin/a')
    bus.advertise('/n', NUMBER, LATCHED, '/skin/a')
    bus.subscribe('/m', NUMBER, QUEUE, '/skin/a')
    bus.serve('/skin/a/s', services.TRIGGER, lambda request, reply: None, '/skin/a')
    until(lambda: looker.graph().services('/skin/a/s') and looker.graph().publishers('/n'))
    graph = looker.graph()
    assert '/skin/a' in graph.nodes()
    (publisher,) = graph.publishers('/n')
    assert (publisher.node, publisher.type_name, publisher.latched) == ('/skin/a', NUMBER, True)
    assert [end.node for end in until(lambda: looker.graph().subscriptions('/m'))] == ['/skin/a']
    assert graph.services('/skin/a/s')[0].type_name == services.TRIGGER
    bus.remove_node('/skin/a')
    until(lambda: '/skin/a' not in looker.graph().nodes())


def test_what_a_process_uses_to_look_around_is_hidden(join: Join, until: Until) -> None:
    bus = join()
    names = until(lambda: bus.graph().nodes())
    assert all(name.rpartition('/')[2].startswith('_tactile_') for name in names if 'tactile' in name)


def test_numbers_of_messages_grow_by_one(join: Join, until: Until) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = _connected(bus.advertise('/n', NUMBER, QUEUE), until)
    for number in range(3):
        publisher.publish(_number(number))
    first, *others = [_next(subscription).sequence for _ in range(3)]
    assert others == [first + 1, first + 2]


@pytest.mark.parametrize(('reported', 'number'), [(1, 1), (900, 900), (None, 2), (2**64 - 1, 2)])
def test_numbers_begin_with_the_publishers_own_where_the_middleware_tells_it(reported: int | None, number: int) -> None:
    subscription = Subscription('/n', NUMBER, QUEUE, '/node', None, lambda _: None)
    receive = receiving(subscription, SystemClock())
    receive(messages.encode(_number(7)), {'publication_sequence_number': reported})
    assert _next(subscription).sequence == number


def test_many_threads_may_publish_and_make_ends_at_once(join: Join, until: Until) -> None:
    bus = join()
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = _connected(bus.advertise('/n', NUMBER, QUEUE), until)

    def work(first: int) -> None:
        for number in range(first, first + 20):
            publisher.publish(_number(number))
            bus.subscribe('/m', NUMBER, QUEUE).close()

    threads = [threading.Thread(target=work, args=(20 * index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(_taken(subscription, 80)) == list(range(80))


def test_closing_takes_less_than_two_seconds_although_a_call_waits(join: Join, until: Until) -> None:
    bus, caller = join(), join()
    asked = threading.Event()
    bus.serve('/s', services.TRIGGER, lambda request, reply: asked.set())

    def ask() -> None:
        with pytest.raises(ServiceTimeoutError):
            _trigger(caller, '/s', 3.0)

    thread = threading.Thread(target=ask)
    thread.start()
    assert asked.wait(10.0)
    begin_s = time.monotonic()
    bus.close()
    took_s = time.monotonic() - begin_s
    thread.join(10.0)
    assert took_s < 2.5


class Growing:
    """What a participant sees of a graph that comes in steps, as with Fast DDS: one's own node, one more, two more."""

    def __init__(self) -> None:
        self._begin_s = time.monotonic()

    def get_fully_qualified_name(self) -> str:
        return '/own'

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        names = [('own', '/'), ('camera', '/'), ('flow', '/left'), ('force', '/left')]
        passed_s = time.monotonic() - self._begin_s
        return names[: 1 + (passed_s > 0.3) + 2 * (passed_s > 0.9)]

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [('/rosout', ['rcl_interfaces/msg/Log'])]

    get_service_names_and_types = get_topic_names_and_types


def test_a_graph_that_still_grows_is_waited_for(emulated: None) -> None:
    graph = importlib.import_module('tactile_nodes.bus.ros2.graph')
    looker = Growing()
    graph.wait_until_settled(looker, time.monotonic(), graph.LONGEST_S)
    assert len(looker.get_node_names_and_namespaces()) == 4
