"""Ends all processes that a launch started, whatever their parent is by now.

Every process of a launch carries a mark in its environment. Its children inherit the mark, even if they leave the
process group or session. This file is also the *guardian*: a program that the launcher starts before all others and
to which it holds a pipe. A launcher that ends normally kills the guardian first. If it ends otherwise (SIGKILL), the
pipe closes, and the guardian ends every process with the mark. It uses only the standard library, so it starts within
milliseconds.
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
_POLL_S = 0.02
_EXEC_LOOKS = 25
_KERNEL_THREAD = 0x0020_0000  # PF_KTHREAD, include/linux/sched.h
# A recorder closes its file on SIGINT. A process that ignores all of these signals stays.
_ESCALATION = ((signal.SIGINT, 2.0), (signal.SIGTERM, 1.0), (signal.SIGKILL, 2.0))


class Guardian:
    """The guardian, as seen by the launcher."""

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
        """Everything has ended: end the guardian, too."""
        self._process.kill()
        self._process.communicate()


def marked(mark: str) -> set[int]:
    """The processes with this mark, except the calling one."""
    return {pid for pid in _processes() if pid != os.getpid() and mark.encode() in environment(pid)}


def environment(pid: int) -> bytes:
    """The environment that a process was started with; empty if it has ended or belongs to another user.

    During `execve`, Linux first shows neither the arguments nor the environment, then the arguments alone. This takes
    0.1 ms, and on a busy machine until the process runs again.
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
    """The process group of a living process; None if it has ended or is a zombie."""
    fields = _stat(pid)
    return int(fields[2]) if fields else None


def end(find: Callable[[], set[int]], escalation: tuple[tuple[signal.Signals, float], ...] = _ESCALATION) -> None:
    """Send stronger and stronger signals to the processes in `find`, until it finds none."""
    for number, patience_s in escalation:
        for pid in find():
            _signal(pid, number)
        if gone(find, patience_s):
            return


def gone(find: Callable[[], set[int]], patience_s: float) -> bool:
    """Whether `find` finds no process within that time."""
    for _ in range(max(1, round(patience_s / _POLL_S))):
        if not find():
            return True
        time.sleep(_POLL_S)
    return not find()


def _processes() -> list[int]:
    try:
        return [int(entry.name) for entry in os.scandir('/proc') if entry.name.isdigit()]
    except FileNotFoundError:
        return []  # not Linux: only process groups are signalled, and a killed launcher leaves its children running


def _is_program(pid: int) -> bool:
    """Whether it is a living process and not a kernel thread; those have no arguments either."""
    fields = _stat(pid)
    return bool(fields) and not int(fields[6]) & _KERNEL_THREAD


def _is_ours(pid: int) -> bool:
    """Whether its environment may be read; processes of other users are not waited for."""
    try:
        return os.geteuid() in {0, Path(f'/proc/{pid}').stat().st_uid}
    except OSError:
        return False  # has ended


def _stat(pid: int) -> list[bytes]:
    """State, parent, group and so on of a living process (proc_pid_stat(5)); empty if it has ended."""
    # pid (name) state parent group …; the name may contain spaces and parentheses.
    fields = _read(pid, 'stat').rpartition(b')')[2].split()
    return fields if len(fields) > 6 and fields[0] not in {b'Z', b'X'} else []


def _read(pid: int, name: str) -> bytes:
    try:
        return Path(f'/proc/{pid}/{name}').read_bytes()
    except OSError:
        return b''  # has ended, or belongs to another user


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except (ProcessLookupError, PermissionError):
        return  # has ended


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    sys.stdin.buffer.read()
    end(lambda: marked(sys.argv[1]))


if __name__ == '__main__':
    main()
