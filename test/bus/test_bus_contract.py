"""What every transport promises, checked with publisher and subscriber in one process."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from agents import IMAGE, NUMBER, got, image, number_of, numbers_of

from tactile_nodes import messages
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.errors import (
    BusError,
    ConfigurationError,
    MessageError,
    ServiceError,
    ServiceTimeoutError,
    ServiceUnavailableError,
)
from tactile_nodes.messages import services, types

QUEUE = Qos('queue', 1000)
LATCHED = Qos('latest', 1, latched=True)
CLOSED = 'is closed'


def test_subscriber_gets_the_very_object_that_was_published(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/image', IMAGE, QUEUE)
    message = image(1)
    bus.advertise('/image', IMAGE, QUEUE).publish(message)
    assert got(subscription).message is message


def test_arrays_of_a_published_message_become_read_only(bus: InProcessBus) -> None:
    message = image(1)
    bus.advertise('/image', IMAGE, QUEUE).publish(message)
    with pytest.raises(ValueError, match='read-only'):
        message.data[0] = 1


def test_arrays_inside_of_messages_inside_of_lists_become_read_only_too(bus: InProcessBus) -> None:
    value = types.ParameterValue(double_array_value=np.zeros(3))
    request = types.SetParameters_Request(parameters=[types.Parameter(name='a', value=value)])
    bus.advertise('/set', 'rcl_interfaces/srv/SetParameters_Request', QUEUE).publish(request)
    with pytest.raises(ValueError, match='read-only'):
        value.double_array_value[0] = 1.0


def test_bytes_are_the_cdr_of_the_message_and_the_other_way_round(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    data = messages.encode(types.Int64(data=5))
    publisher.publish(types.Int64(data=5))
    publisher.publish_bytes(data)
    first, second = got(subscription), got(subscription)
    assert (first.data, second.message.data) == (data, 5)


def test_several_publishers_of_a_topic_are_reported_apart(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    one, two = (bus.advertise('/n', NUMBER, QUEUE) for _ in range(2))
    for number in (1, 2):
        one.publish(types.Int64(data=number))
        two.publish(types.Int64(data=10 * number))
    by_publisher: dict[str, list[tuple[int, int]]] = {}
    for entry in iter(subscription.take, None):
        by_publisher.setdefault(entry.publisher, []).append((entry.sequence, number_of(entry)))
    assert sorted(by_publisher.values()) == [[(1, 1), (2, 2)], [(1, 10), (2, 20)]]


@pytest.mark.parametrize(('qos', 'kept'), [(Qos('latest', 1), [10]), (Qos('queue', 4), [7, 8, 9, 10])])
def test_the_newest_are_kept_in_order_and_what_gave_way_is_counted(
    bus: InProcessBus, qos: Qos, kept: list[int]
) -> None:
    subscription = bus.subscribe('/n', NUMBER, qos)
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    for number in range(1, 11):
        publisher.publish(types.Int64(data=number))
    assert (numbers_of(subscription), subscription.dropped, subscription.received) == (kept, 10 - len(kept), 10)


def test_latched_message_is_given_once_to_each_who_comes_late(bus: InProcessBus) -> None:
    early = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = bus.advertise('/n', NUMBER, LATCHED)
    publisher.publish(types.Int64(data=1))
    publisher.publish(types.Int64(data=2))
    late, later = (bus.subscribe('/n', NUMBER, QUEUE) for _ in range(2))
    publisher.publish(types.Int64(data=3))
    assert (numbers_of(early), numbers_of(late), numbers_of(later)) == ([1, 2, 3], [2, 3], [2, 3])


def test_late_subscriber_of_a_topic_that_is_not_latched_gets_what_comes(bus: InProcessBus) -> None:
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    publisher.publish(types.Int64(data=1))
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher.publish(types.Int64(data=2))
    assert numbers_of(subscription) == [2]


def test_latched_message_meets_a_subscriber_once_however_both_race(bus: InProcessBus) -> None:
    publisher = bus.advertise('/n', NUMBER, LATCHED)
    done = threading.Event()

    def publish() -> None:
        for number in range(1, 301):
            publisher.publish(types.Int64(data=number))
        done.set()

    thread = threading.Thread(target=publish)
    thread.start()
    made = []
    while not done.is_set() and len(made) < 100:
        made.append(bus.subscribe('/n', NUMBER, QUEUE))
    thread.join()
    for subscription in made:
        found = numbers_of(subscription)
        assert found == list(range(found[0], 301)) if found else True


def test_messages_published_from_many_threads_arrive_in_the_order_of_their_numbers(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = bus.advertise('/n', NUMBER, QUEUE)

    def publish(first: int) -> None:
        for number in range(first, first + 100):
            publisher.publish(types.Int64(data=number))

    threads = [threading.Thread(target=publish, args=(100 * index,)) for index in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    received = [subscription.take() for _ in range(800)]
    assert [entry.sequence for entry in received if entry] == list(range(1, 801))
    assert sorted(number_of(entry) for entry in received if entry) == list(range(800))


def test_listeners_are_counted(bus: InProcessBus) -> None:
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    assert publisher.listeners == 1
    subscription.close()
    assert publisher.listeners == 0


def test_message_of_another_type_is_refused_in_a_sentence(bus: InProcessBus) -> None:
    with pytest.raises(BusError, match='/n carries std_msgs/msg/Int64, not sensor_msgs/msg/Image'):
        bus.advertise('/n', NUMBER, QUEUE).publish(image(1))


def test_subscription_of_another_type_gets_nothing(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', IMAGE, QUEUE)
    bus.advertise('/n', NUMBER, QUEUE).publish(types.Int64(data=1))
    assert subscription.take() is None


def test_unknown_type_is_refused(bus: InProcessBus) -> None:
    with pytest.raises(MessageError, match='no message type'):
        bus.advertise('/n', 'std_msgs/msg/Nothing', QUEUE)
    with pytest.raises(MessageError, match='no message type'):
        bus.subscribe('/n', 'std_msgs/msg/Nothing', QUEUE)


def test_latched_message_that_cannot_be_encoded_is_refused_before_anybody_has_it(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    publisher = bus.advertise('/n', NUMBER, LATCHED)
    with pytest.raises(MessageError):
        publisher.publish(types.Int64(data=2**70))
    publisher.publish(types.Int64(data=1))
    assert numbers_of(subscription) == [1]


def test_publishing_after_closing_is_an_error_and_closing_twice_is_none(bus: InProcessBus) -> None:
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    publisher.close()
    publisher.close()
    with pytest.raises(BusError, match=f'the publisher of /n {CLOSED}'):
        publisher.publish(types.Int64(data=1))


def test_closing_a_subscription_wakes_who_waits_for_it(bus: InProcessBus) -> None:
    subscription = bus.subscribe('/n', NUMBER, QUEUE)
    got: list[Any] = []
    thread = threading.Thread(target=lambda: got.append(subscription.get(10.0)))
    thread.start()
    subscription.close()
    subscription.close()
    thread.join(30.0)
    assert got == [None]


def test_closed_bus_refuses_everything_in_a_sentence(bus: InProcessBus) -> None:
    publisher = bus.advertise('/n', NUMBER, QUEUE)
    bus.close()
    bus.close()
    for use in (
        lambda: publisher.publish(types.Int64()),
        lambda: bus.advertise('/n', NUMBER, QUEUE),
        lambda: bus.subscribe('/n', NUMBER, QUEUE),
        lambda: bus.serve('/s', services.TRIGGER, lambda request, reply: None),
        lambda: bus.call('/s', services.TRIGGER, types.Trigger_Request()),
    ):
        with pytest.raises(BusError, match=CLOSED):
            use()


def test_graph_shows_nodes_topics_and_services_while_they_last(bus: InProcessBus) -> None:
    bus.add_node('/skin/a')
    publisher = bus.advertise('/n', NUMBER, LATCHED, '/skin/a')
    bus.subscribe('/m', NUMBER, QUEUE, '/skin/a')
    service = bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/skin/a')
    graph = bus.graph()
    assert graph.nodes() == ['/skin/a']
    assert graph.topics() == {'/m': [NUMBER], '/n': [NUMBER]}
    assert graph.publishers('/n')[0].latched
    assert graph.services()[0].node == '/skin/a'
    publisher.close()
    service.close()
    bus.remove_node('/skin/a')
    assert (bus.graph().nodes(), bus.graph().publishers(), bus.graph().services()) == ([], [], [])


def test_service_is_called_and_answers(bus: InProcessBus) -> None:
    bus.serve('/s', services.SET_BOOL, lambda request, reply: reply(types.SetBool_Response(success=request.data)))
    assert bus.call('/s', services.SET_BOOL, types.SetBool_Request(data=True)).success


def test_service_may_answer_later_from_another_thread(bus: InProcessBus) -> None:
    def handle(request: Any, reply: Any) -> None:
        threading.Timer(0.05, reply, [types.Trigger_Response(message='later')]).start()

    bus.serve('/s', services.TRIGGER, handle)
    assert bus.call('/s', services.TRIGGER, types.Trigger_Request()).message == 'later'


def test_call_of_nobody_says_how_to_look_for_services(bus: InProcessBus) -> None:
    with pytest.raises(ServiceUnavailableError, match=r'no node offers the service /s; .*tactile service list'):
        bus.call('/s', services.TRIGGER, types.Trigger_Request())


def test_call_without_an_answer_ends_after_its_timeout(bus: InProcessBus) -> None:
    bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/busy')
    with pytest.raises(ServiceTimeoutError, match=r'/busy did not respond to /s within 0\.05 s'):
        bus.call('/s', services.TRIGGER, types.Trigger_Request(), timeout_s=0.05)


def test_call_of_another_type_is_refused(bus: InProcessBus) -> None:
    bus.serve('/s', services.TRIGGER, lambda request, reply: None)
    with pytest.raises(ServiceError, match='/s is a std_srvs/srv/Trigger, not a std_srvs/srv/SetBool'):
        bus.call('/s', services.SET_BOOL, types.SetBool_Request())


def test_refusal_of_a_service_is_reported_in_its_own_words(bus: InProcessBus) -> None:
    bus.serve('/s', services.TRIGGER, lambda request, reply: reply(ConfigurationError('no rest image yet')))
    with pytest.raises(ServiceError, match='/s: no rest image yet'):
        bus.call('/s', services.TRIGGER, types.Trigger_Request())


def test_service_is_served_once_and_again_after_it_was_closed(bus: InProcessBus) -> None:
    first = bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/a')
    with pytest.raises(BusError, match='/s is already offered by /a'):
        bus.serve('/s', services.TRIGGER, lambda request, reply: None, '/b')
    first.close()
    bus.serve('/s', services.TRIGGER, lambda request, reply: reply(types.Trigger_Response()), '/b')
    first.close()  # its late second closing does not take the new one away
    assert bus.call('/s', services.TRIGGER, types.Trigger_Request()) is not None


def test_a_relative_name_of_a_topic_is_refused_as_no_node_uses_it(bus: InProcessBus) -> None:
    """The names of the topic table are relative: `bus.subscribe(topics.WRENCH.name, …)` would wait for ever."""
    for act in (bus.subscribe, bus.advertise):
        with pytest.raises(BusError, match=r"'image' is not the full name of a topic, .* with a slash: /image"):
            act('image', IMAGE, QUEUE)
