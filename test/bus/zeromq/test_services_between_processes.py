"""Calls between processes, and what becomes of them when the other side does not do its part."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable

import pytest
from agents import Other, until

from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import BusError, MessageError
from tactile_nodes.messages import services, types

Start = Callable[..., Other]
Join = Callable[..., ZmqBus]


@pytest.fixture
def bus(join: Join) -> ZmqBus:
    return join()


def _call(bus: ZmqBus, timeout_s: float = 30.0) -> str:
    return str(bus.call('/s', services.TRIGGER, types.Trigger_Request(), timeout_s).message)


def _serving(bus: ZmqBus, other: Other, behaviour: str) -> Other:
    other.serve('/s', behaviour)
    until(lambda: bus.graph().services('/s'))
    return other


def test_many_calls_at_once_are_all_answered(bus: ZmqBus, start: Start) -> None:
    _serving(bus, start(), 'answer')
    answers: list[str] = []
    threads = [threading.Thread(target=lambda: answers.append(_call(bus))) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 20


@pytest.mark.parametrize(
    ('behaviour', 'sentence'),
    [
        ('refuse', 'ServiceError: /s: not today'),
        ('nonsense', 'ServiceError: /s: expected a std_srvs/srv/Trigger_Response, not a std_msgs/msg/Int64'),
        ('raise', 'ServiceError: /s: the service failed because of a bug'),
        ('silent', 'ServiceTimeoutError: no response from /s within 0.2 s; its node is alive but busy or stuck'),
    ],
)
def test_each_way_of_not_answering_has_its_sentence(start: Start, behaviour: str, sentence: str) -> None:
    server, client = start(), start()
    server.serve('/s', behaviour)
    assert client.call('/s', 0.2 if behaviour == 'silent' else 30.0) == sentence
    server.serve('/after', 'answer')
    assert client.call('/after').startswith('from')  # and the server goes on


def test_stopped_server_is_a_timeout(bus: ZmqBus, start: Start) -> None:
    other, client = _serving(bus, start(), 'answer'), start()
    other.signal(signal.SIGSTOP)
    assert client.call('/s', 0.2).startswith('ServiceTimeoutError')


def test_server_killed_during_a_call_ends_the_call_at_once(bus: ZmqBus, start: Start) -> None:
    server, client = _serving(bus, start(), 'silent'), start()
    answer = client.begin('call', '/s', 60.0)
    until(server.count_calls)
    server.signal(signal.SIGKILL)
    assert answer() == 'ServiceUnavailableError: the process that served /s has ended'


def test_service_of_a_restarted_process_answers_again(bus: ZmqBus, start: Start) -> None:
    first = _serving(bus, start(), 'answer')
    first.signal(signal.SIGKILL)
    second = start()
    second.serve('/s', 'answer')
    until(lambda: bus.graph().services('/s'))
    assert _call(bus) == f'from {second.pid()}'


def test_call_of_a_wrong_type_is_refused(start: Start, bus: ZmqBus) -> None:
    _serving(bus, start(), 'answer')
    with pytest.raises(BusError, match='/s is a std_srvs/srv/Trigger, not a std_srvs/srv/SetBool'):
        bus.call('/s', services.SET_BOOL, types.SetBool_Request())


def test_request_of_a_wrong_type_is_refused_before_it_is_sent(start: Start, bus: ZmqBus) -> None:
    _serving(bus, start(), 'answer')
    with pytest.raises(MessageError, match='expected a std_srvs/srv/Trigger_Request'):
        bus.call('/s', services.TRIGGER, types.Int64())


def test_closing_the_bus_ends_calls_of_other_threads(bus: ZmqBus, start: Start) -> None:
    server = _serving(bus, start(), 'silent')
    raised: list[BusError] = []

    def call() -> None:
        try:
            _call(bus, 60.0)
        except BusError as error:
            raised.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    until(server.count_calls)
    bus.close()
    thread.join(30.0)
    assert len(raised) == 1
