"""Signals, heard by a thread of their own."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def that_end() -> set[signal.Signals]:
    """The signals that ask a program to end: Ctrl-C, SIGTERM, and the end of its terminal, unless ``nohup`` is used."""
    hears_terminal = signal.getsignal(signal.SIGHUP) != signal.SIG_IGN
    return {signal.SIGINT, signal.SIGTERM, *({signal.SIGHUP} if hears_terminal else ())}


@contextmanager
def handling(numbers: set[signal.Signals], act: Callable[[signal.Signals], None]) -> Iterator[None]:
    """Have `act` called for each of these signals, in a thread of its own, for as long as this is held.

    Python calls a handler in the main thread alone, when that next runs. A signal that comes just before it begins to
    wait does not wake it, and would be lost; one that comes while it holds a lock finds that lock taken. Here the
    signal is written to a pipe at once, whatever the main thread does (`signal.set_wakeup_fd`). Only the main thread
    may enter.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    descriptor_before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = {number: signal.signal(number, _let_it_be_written) for number in numbers}
    threading.Thread(target=_hear, args=(reading, numbers, act), name='signals', daemon=True).start()
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(descriptor_before)
        os.close(writing)  # its thread ends


def _hear(reading: int, numbers: set[signal.Signals], act: Callable[[signal.Signals], None]) -> None:
    with open(reading, 'rb', buffering=0) as pipe:
        while number := pipe.read(1):
            if number[0] in numbers:  # others that Python handles are written, too
                act(signal.Signals(number[0]))


def _let_it_be_written(number: int, frame: object) -> None:
    """A signal without a handler would end the process."""
