"""The only reader of time.

One time base for everything on a host: CLOCK_MONOTONIC in integer nanoseconds plus one constant for as long as
the machine runs (the *anchor*). So a stamp reads as a date, any two processes of a host can subtract their stamps,
V4L2's monotonic stamps convert by one addition, and no stamp ever jumps when NTP or a person sets the wall clock.
"""

from __future__ import annotations

import os
import threading
import time
from functools import cache
from pathlib import Path
from typing import Protocol

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError

NS_PER_S = 1_000_000_000


class Clock(Protocol):
    """What tells a part of the system the time; handed in, never fetched."""

    def now_ns(self) -> int:
        """The time in nanoseconds on the host's time base."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return when `now_ns()` has reached `deadline_ns`; at once if it is past."""
        ...


class SystemClock:
    """The host's clock."""

    def __init__(self) -> None:
        self._anchor_ns = anchor_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() + self._anchor_ns

    def sleep_until(self, deadline_ns: int) -> None:
        while (left_ns := deadline_ns - self.now_ns()) > 0:
            time.sleep(left_ns / NS_PER_S)


class SteppedClock:
    """A clock that stands still until a test or a replay moves it."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns
        self._moved = threading.Condition()

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        with self._moved:
            self._moved.wait_for(lambda: self._now_ns >= deadline_ns)

    def advance(self, seconds: float) -> None:
        """Move the time forward and wake whoever waited for it."""
        self.set_ns(self._now_ns + round(seconds * NS_PER_S))

    def set_ns(self, now_ns: int) -> None:
        """Put the time to `now_ns` (a replayed /clock does this)."""
        with self._moved:
            self._now_ns = now_ns
            self._moved.notify_all()


def perf_ns() -> int:
    """A counter for measuring how long a computation took; its zero means nothing."""
    return time.perf_counter_ns()


def monotonic_s() -> float:
    """CLOCK_MONOTONIC in seconds, for deadlines of operating-system calls."""
    return time.monotonic()


def from_monotonic_ns(monotonic_ns: int) -> int:
    """A kernel stamp (V4L2's, say) on CLOCK_MONOTONIC as a stamp on the host's time base."""
    return monotonic_ns + anchor_ns()


def wall_ns() -> int:
    """The wall clock, which may jump: only for names of folders and for the border to ROS 2."""
    return time.time_ns()


@cache
def anchor_ns() -> int:
    """The constant between CLOCK_MONOTONIC and the dates of this boot, the same for every process of this user.

    The first process after a boot measures it and leaves it in the run folder; the others read it there.
    """
    measured_ns = time.time_ns() - time.monotonic_ns()
    return _first_said(_anchor_file(), measured_ns)


def keep_anchor() -> None:
    """Leave the anchor in the run folder once more, in case somebody has emptied it."""
    _first_said(_anchor_file(), anchor_ns())


def _anchor_file() -> Path:
    return paths.run_directory() / f'clock-{_boot_id()}'


def _first_said(file: Path, value: int) -> int:
    draft = file.with_name(f'{file.name}.{os.getpid()}.{threading.get_ident()}')
    try:
        draft.write_text(str(value), encoding='ascii')
        os.link(draft, file)  # atomic: whoever comes second gets an error, never half a file
    except FileExistsError:
        return _said(file, draft, value)
    except OSError as error:
        raise ConfigurationError(f'cannot write to {file.parent} ({error.strerror}); is the disk full?') from error
    finally:
        draft.unlink(missing_ok=True)
    return value


def _said(file: Path, draft: Path, value: int) -> int:
    try:
        return int(file.read_text(encoding='ascii'))
    except (OSError, ValueError):  # damaged, or gone again: ours is as good as any
        draft.replace(file)
        return value


def _boot_id() -> str:
    boot_id = Path('/proc/sys/kernel/random/boot_id')
    return boot_id.read_text(encoding='ascii').strip() if boot_id.exists() else 'unknown'
