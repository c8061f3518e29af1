"""The only module that reads the time.

All processes of a host share one time base: CLOCK_MONOTONIC in integer nanoseconds plus a constant that is fixed until
the next boot (the *anchor*). So a stamp reads as a date, stamps of two processes of a host can be subtracted, V4L2's
monotonic stamps convert by one addition, and no stamp jumps when NTP or a person sets the wall clock.
"""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Protocol

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError

NS_PER_S = 1_000_000_000


class Clock(Protocol):
    """The source of time of a part of the system; always passed in as an argument."""

    def now_ns(self) -> int:
        """The time in nanoseconds on the host's time base."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return when `now_ns()` has reached `deadline_ns`; at once if that is in the past."""
        ...


class SystemClock:
    def __init__(self) -> None:
        self._anchor_ns = anchor_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() + self._anchor_ns

    def sleep_until(self, deadline_ns: int) -> None:
        while (left_ns := deadline_ns - self.now_ns()) > 0:
            time.sleep(left_ns / NS_PER_S)


class SteppedClock:
    """A clock that stands still until a test or a replay advances it."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns
        self._moved = threading.Condition()

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        with self._moved:
            self._moved.wait_for(lambda: self._now_ns >= deadline_ns)

    def advance(self, seconds: float) -> None:
        """Advance the time, and wake the threads whose deadline is reached."""
        self.set_ns(self._now_ns + round(seconds * NS_PER_S))

    def set_ns(self, now_ns: int) -> None:
        """Set the time to `now_ns` (used for a replayed /clock)."""
        with self._moved:
            self._now_ns = now_ns
            self._moved.notify_all()


def perf_ns() -> int:
    """A counter to measure the duration of a computation; its zero has no meaning."""
    return time.perf_counter_ns()


def monotonic_s() -> float:
    """CLOCK_MONOTONIC in seconds, for deadlines of operating-system calls."""
    return time.monotonic()


def thread_s() -> float:
    """Processor time that the calling thread has used, in seconds; it does not count while it waits for its turn."""
    return time.thread_time()


def from_monotonic_ns(monotonic_ns: int) -> int:
    """Convert a kernel stamp on CLOCK_MONOTONIC (V4L2's, for example) to the host's time base."""
    return monotonic_ns + anchor_ns()


def wall_ns() -> int:
    """The wall clock, which may jump: only for folder names and the interface to ROS 2."""
    return time.time_ns()


@cache
def anchor_ns() -> int:
    """The offset between CLOCK_MONOTONIC and the dates of this boot, the same for every process of this user.

    The first process after a boot measures it and writes it to the run folder, where the others read it. Just after a
    login those that ran before still have it in another folder.
    """
    measured_ns, file = time.time_ns() - time.monotonic_ns(), _anchor_file()
    for folder in paths.run_directories():
        with suppress(OSError, ValueError):
            if folder.stat().st_uid == os.getuid():
                return _first_written(file, int((folder / file.name).read_text(encoding='ascii')))
    return _first_written(file, measured_ns)


def keep_anchor() -> None:
    """Write the anchor to the run folder again, in case the folder was emptied."""
    _first_written(_anchor_file(), anchor_ns())


def _anchor_file() -> Path:
    return paths.run_directory() / f'clock-{_boot_id()}'


def _first_written(file: Path, value: int) -> int:
    draft = file.with_name(f'{file.name}.{os.getpid()}.{threading.get_ident()}')
    try:
        draft.write_text(str(value), encoding='ascii')
        os.link(draft, file)  # atomic: the second process gets an error, never a partial file
    except FileExistsError:
        return _already_written(file, draft, value)
    except OSError as error:
        raise ConfigurationError(f'cannot write to {file.parent} ({error.strerror}); is the disk full?') from error
    finally:
        draft.unlink(missing_ok=True)
    return value


def _already_written(file: Path, draft: Path, value: int) -> int:
    try:
        return int(file.read_text(encoding='ascii'))
    except (OSError, ValueError):  # damaged or deleted, so our own value is as good
        draft.replace(file)
        return value


def _boot_id() -> str:
    boot_id = Path('/proc/sys/kernel/random/boot_id')
    return boot_id.read_text(encoding='ascii').strip() if boot_id.exists() else 'unknown'
