"""Waiting for messages in a program that Ctrl-C may interrupt at any step."""

from __future__ import annotations

import signal
import threading

import pytest

from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription

TYPE = 'std_msgs/msg/String'
TIMES, WITHIN_S = 40, 3e-4


@pytest.fixture
def subscription() -> Subscription:
    return Subscription('/greeting', TYPE, Qos('queue', 10), '/listener', None, lambda _: None)


def received(number: int) -> Received:
    return Received(TYPE, 'speaker', number, 0, 0, data=b'')


def test_who_waits_is_woken_by_a_message_and_by_the_end(subscription: Subscription) -> None:
    first, found = threading.Event(), list[Received | None]()

    def wait() -> None:
        found.append(subscription.get())
        first.set()
        found.append(subscription.get())

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    subscription.put(received(1))
    assert first.wait(10)
    subscription.close()
    waiting.join(10)
    assert [each and each.sequence for each in found] == [1, None]


def test_who_waited_in_vain_leaves_nothing_behind(subscription: Subscription) -> None:
    assert subscription.get(0.0) is None
    assert subscription.get(0.001) is None
    assert not subscription._getting


@pytest.mark.timeout(30)
def test_an_interrupt_at_any_step_holds_up_nobody(subscription: Subscription) -> None:
    """It may come between any two steps of `get`, while another thread brings messages without a pause."""
    enough, here = threading.Event(), threading.get_ident()

    def bring() -> None:
        number = 0
        while not enough.is_set():
            number += 1
            subscription.put(received(number))

    def interrupt(after_s: float) -> None:
        enough.wait(after_s)
        signal.pthread_kill(here, signal.SIGUSR1)

    bringing = threading.Thread(target=bring, daemon=True)
    before = signal.signal(signal.SIGUSR1, signal.default_int_handler)
    bringing.start()
    try:
        for turn in range(TIMES):
            interrupting = threading.Thread(target=interrupt, args=(WITHIN_S * turn / TIMES,), daemon=True)
            with pytest.raises(KeyboardInterrupt):
                interrupting.start()
                while True:
                    subscription.get()
            interrupting.join(10)
    finally:
        signal.signal(signal.SIGUSR1, before)
        enough.set()
    bringing.join(10)
    assert not bringing.is_alive(), 'an interrupted get still holds the lock'
