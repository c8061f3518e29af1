"""Ends what a launch started, whoever its parent is by now.

Every process of a launch carries a mark in its environment, which its own children inherit, even those that leave its
process group or session. This file is also the *guardian*: a program that the launcher starts before all others and
holds by a pipe. When the launcher is gone without having said farewell (SIGKILL), the pipe ends, and the guardian ends
every process with the mark. It needs nothing but the standard library, so that it starts in milliseconds.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

VARIABLE = 'TACTILE_LAUNCH'
_FAREWELL = b'done'
_POLL_S = 0.02
_EXEC_LOOKS = 25
_KERNEL_THREAD = 0x0020_0000  # PF_KTHREAD, include/linux/sched.h
# A recorder that gets SIGINT closes its file; whatever ignores that gets no second chance after these.
_ESCALATION = ((signal.SIGINT, 2.0), (signal.SIGTERM, 1.0), (signal.SIGKILL, 2.0))


class Guardian:
    """The guardian as the launcher holds it."""

    def __init__(self, mark: str) -> None:
        environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', str(Path(__file__)), mark],
            env=environment,
            cwd='/',
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def dismiss(self) -> None:
        """Say farewell: everything is ended."""
        self._process.communicate(_FAREWELL)


def marked(mark: str) -> set[int]:
    """The processes with this mark, but not the calling one."""
    return {pid for pid in _processes() if pid != os.getpid() and mark.encode() in environment(pid)}


def environment(pid: int) -> bytes:
    """The variables that a process was started with; none of one that is gone, or somebody else's.

    While a process becomes another program (`execve`), Linux shows first neither its words nor its variables, then its
    words alone. That takes a tenth of a millisecond, and on a busy machine as long as others have the processor.
    """
    for _ in range(_EXEC_LOOKS):
        words = _read(pid, 'cmdline')
        if (found := _read(pid, 'environ')) or not (_is_ours(pid) and _is_program(pid)):
            return found
        time.sleep(_POLL_S)
        if words:
            break
    return _read(pid, 'environ')


def group(leader: int) -> set[int]:
    """The living processes of a process group."""
    try:
        os.killpg(leader, 0)
    except (ProcessLookupError, PermissionError):
        return set()
    return {pid for pid in _processes() if group_of(pid) == leader}


def group_of(pid: int) -> int | None:
    """The process group of a living process; None if it is gone, or a zombie."""
    fields = _stat(pid)
    return int(fields[2]) if fields else None


def end(find: Callable[[], set[int]], escalation: tuple[tuple[signal.Signals, float], ...] = _ESCALATION) -> None:
    """Signal whatever `find` finds, ever harder, until it finds nothing."""
    for number, patience_s in escalation:
        for pid in find():
            _signal(pid, number)
        if gone(find, patience_s):
            return


def gone(find: Callable[[], set[int]], patience_s: float) -> bool:
    """Whether `find` finds nothing within that time."""
    for _ in range(max(1, round(patience_s / _POLL_S))):
        if not find():
            return True
        time.sleep(_POLL_S)
    return not find()


def _processes() -> list[int]:
    try:
        return [int(entry.name) for entry in os.scandir('/proc') if entry.name.isdigit()]
    except FileNotFoundError:
        return []  # no Linux: only process groups are signalled, and a killed launcher leaves its children


def _is_program(pid: int) -> bool:
    """Whether it is a living process, and no thread of the kernel: those have no words either."""
    fields = _stat(pid)
    return bool(fields) and not int(fields[6]) & _KERNEL_THREAD


def _is_ours(pid: int) -> bool:
    """Whether its variables may be read at all: those of other accounts may not, and are not waited for."""
    try:
        return os.geteuid() in {0, Path(f'/proc/{pid}').stat().st_uid}
    except OSError:
        return False  # ended meanwhile


def _stat(pid: int) -> list[bytes]:
    """State, parent, group and so on of a living process (proc_pid_stat(5)); nothing of one that has ended."""
    # pid (name) state parent group …; the name may hold spaces and parentheses.
    fields = _read(pid, 'stat').rpartition(b')')[2].split()
    return fields if len(fields) > 6 and fields[0] not in {b'Z', b'X'} else []


def _read(pid: int, name: str) -> bytes:
    try:
        return Path(f'/proc/{pid}/{name}').read_bytes()
    except OSError:
        return b''  # ended meanwhile, or somebody else's


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except (ProcessLookupError, PermissionError):
        return  # ended meanwhile


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if sys.stdin.buffer.read() != _FAREWELL:
        end(lambda: marked(sys.argv[1]))


if __name__ == '__main__':
    main()
