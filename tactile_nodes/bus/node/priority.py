"""How urgently a process of nodes asks for the processor.

What watches a machine, and what plays one, must not wait for a program that only computes. ``TACTILE_NICE`` names the
niceness of a process (nice(1): -20 comes first, 0 is usual); the launch files of rigs set it. Linux gives sessions
equal shares, whatever the niceness of their processes, so that of the session is set, too, if the process leads one, as
those of a launch do (autogroup, sched(7)). An account may go below 0 only where it is permitted to (RLIMIT_NICE,
limits.conf(5)); where it is not, the process stays as it is.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from tactile_nodes.errors import ConfigurationError

VARIABLE = 'TACTILE_NICE'
SESSION = Path('/proc/self/autogroup')


def take_priority() -> None:
    """For this thread and those that it starts.

    Raises:
        ConfigurationError: what is asked for is no niceness.
    """
    wanted = _wanted()
    if wanted is None:
        return
    with suppress(OSError):  # `lacking` says so to who has to know
        os.setpriority(os.PRIO_PROCESS, 0, wanted)
        _set_session(wanted)


def restore_priority() -> None:
    """Undo a niceness above 0, so that the process can end within two seconds of being asked to on a busy computer.

    Any account may undo that of its session; that of threads only one that may go below its niceness.
    """
    if (_wanted() or 0) <= 0:
        return
    with suppress(OSError):
        _set_session(0)
    for thread in Path('/proc/self/task').glob('*'):
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, int(thread.name), 0)


def lacking() -> str:
    """What to tell a person when this thread did not get what was asked for; empty: it did."""
    wanted, given = _wanted(), os.getpriority(os.PRIO_PROCESS, 0)
    if wanted is None or given <= wanted:
        return ''
    return (
        f'this user may not raise process priority (niceness {wanted} wanted, {given} given): on a loaded '
        'computer devices may seem silent; see docs/collection.md'
    )


def overload() -> float:
    """Programs that want to run, per processor, but at least 1: so many times as long as usual others may take."""
    return max(1.0, os.getloadavg()[0] / len(os.sched_getaffinity(0)))


def crowded() -> str:
    """What to tell a person for whom a device was silent; empty: this computer has no more programs than processors."""
    if overload() == 1.0:
        return ''
    programs, processors = os.getloadavg()[0], len(os.sched_getaffinity(0))
    permit = ', or allow this user to raise process priority (docs/collection.md)' if lacking() else ''
    return (
        f'this computer is overloaded ({programs:.0f} programs on {processors} processors), so devices seem silent: '
        f'stop some{permit}, then start again: recorded presses are kept, and the run continues with the next press'
    )


def _set_session(niceness: int) -> None:
    if SESSION.exists() and os.getsid(0) == os.getpid():
        SESSION.write_text(str(niceness), encoding='ascii')


def _wanted() -> int | None:
    text = os.environ.get(VARIABLE, '')
    if not text:
        return None
    try:
        wanted = int(text)
    except ValueError:
        wanted = 20
    if not -20 <= wanted <= 19:
        raise ConfigurationError(f'{VARIABLE} is {text!r}; set it to an integer from -20 to 19, or unset it')
    return wanted
