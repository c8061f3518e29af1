"""How a thread waits for work: never longer than it was asked to."""

from __future__ import annotations

import queue
import threading

import pytest

from tactile_nodes.bus.node.taking import take
from tactile_nodes.clock import monotonic_s

PAUSE_S = 1e-6


def test_who_waits_for_a_moment_is_back_however_often_it_is_put_aside() -> None:
    """The first wait of a node whose timer is due already: some of 20 000 are put aside for longer than that."""
    now: list[queue.SimpleQueue[str]] = [queue.SimpleQueue()]
    began_s = [monotonic_s()]
    ended = threading.Event()

    def wake_who_is_stuck() -> None:
        while not ended.wait(0.1):
            if monotonic_s() - began_s[0] > 1.0:
                now[0].put('stuck')

    guard = threading.Thread(target=wake_who_is_stuck)
    guard.start()
    try:
        for _ in range(20_000):
            now[0] = queue.SimpleQueue()
            began_s[0] = monotonic_s()
            with pytest.raises(queue.Empty):
                take(now[0], PAUSE_S)
    finally:
        ended.set()
        guard.join()


def test_what_waits_is_taken_in_order_and_what_comes_later_is_waited_for() -> None:
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    waiting.put(1)
    waiting.put(2)
    assert [take(waiting, 0.0), take(waiting, None)] == [1, 2]
    with pytest.raises(queue.Empty):
        take(waiting, 0.0)
    later = threading.Timer(0.05, waiting.put, (3,))
    later.start()
    assert take(waiting, None) == 3
    later.join()
