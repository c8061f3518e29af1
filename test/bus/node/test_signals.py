"""Signals are heard whatever the main thread does, and only for as long as somebody listens."""

from __future__ import annotations

import signal
import threading

from tactile_nodes.bus.node.signals import handling

SOON_S = 20.0


def test_a_signal_is_heard_that_does_not_wake_the_main_thread() -> None:
    come, came = threading.Event(), []

    def note(number: signal.Signals) -> None:
        came.append(number)
        come.set()

    with handling({signal.SIGUSR1}, note):
        other = threading.Thread(target=lambda: signal.pthread_kill(threading.get_ident(), signal.SIGUSR1))
        other.start()
        assert come.wait(SOON_S)
        other.join()
    assert came == [signal.SIGUSR1]


def test_a_signal_is_heard_that_comes_while_the_main_thread_holds_what_is_needed() -> None:
    come = threading.Event()
    with handling({signal.SIGUSR1}, lambda _: come.set()):
        with come._cond:  # type: ignore[attr-defined] - as it does for an instant whenever it begins to wait
            signal.raise_signal(signal.SIGUSR1)
        assert come.wait(SOON_S)


def test_others_are_not_taken_for_it_and_all_are_as_before_at_the_end() -> None:
    ours, theirs = threading.Event(), []
    before = signal.signal(signal.SIGUSR2, lambda number, _: theirs.append(number))
    try:
        with handling({signal.SIGUSR1}, lambda _: ours.set()):
            signal.raise_signal(signal.SIGUSR2)
            assert theirs == [signal.SIGUSR2] and not ours.wait(0.1)
        assert signal.set_wakeup_fd(-1) == -1
        assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGUSR2, before)


def test_one_listens_within_another() -> None:
    outer, inner = threading.Event(), threading.Event()
    with handling({signal.SIGUSR1}, lambda _: outer.set()):
        with handling({signal.SIGUSR1}, lambda _: inner.set()):
            signal.raise_signal(signal.SIGUSR1)
            assert inner.wait(SOON_S) and not outer.is_set()
        signal.raise_signal(signal.SIGUSR1)
        assert outer.wait(SOON_S)
