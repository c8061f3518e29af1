"""One child process: started in its own session, its output read line by line, its end reported."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from tactile_nodes.bus.node.keeping import VARIABLE as KEEP
from tactile_nodes.launching.processes import orphans
from tactile_nodes.launching.processes.output import LaunchLog, Line
from tactile_nodes.launching.processes.plan import ProcessPlan

_LONGEST_LINE = 1 << 16
_GROUP_PATIENCE_S = 0.5
_OUTPUT_PATIENCE_S = 0.2  # for an output that another process holds open
_OUTPUT_LOOKS = 20  # if the output never ends
_ESCALATION = ((signal.SIGTERM, 1.0), (signal.SIGKILL, 1.0))


class Child:
    """A running process.

    It leads a session, so Ctrl-C in a terminal does not reach it directly. The launcher forwards it once to the whole
    group. The standard input is a pipe that stays open and empty.

    Args:
        plan: what to start.
        mark: the environment mark by which `orphans` finds it.
        log: receives its lines, from the threads that read them.
        ended: called from such a thread after it has ended, with its exit code, or minus the signal that killed it.

    Raises:
        OSError: the program could not be started.
    """

    def __init__(self, plan: ProcessPlan, mark: str, log: LaunchLog, ended: Callable[[int], None]) -> None:
        self._plan = plan
        self._log = log
        self._ended = ended
        open_pair = pty.openpty if plan.emulate_tty else os.pipe
        outputs = [open_pair(), open_pair()]
        try:
            with _blocked({signal.SIGINT} if plan.holds_sigint else set()):
                self._process = subprocess.Popen(
                    ' '.join(plan.command) if plan.shell else plan.command,
                    shell=plan.shell,
                    cwd=plan.cwd,
                    env=_environment(plan, mark, log.folder),
                    stdin=subprocess.PIPE,
                    stdout=outputs[0][1],
                    stderr=outputs[1][1],
                    start_new_session=True,
                )
        except ValueError as error:  # a null byte in a word or variable
            _close(reading for reading, _ in outputs)
            raise OSError(0, str(error)) from error
        except OSError:
            _close(reading for reading, _ in outputs)
            raise
        finally:
            _close(writing for _, writing in outputs)
        self.pid = self._process.pid
        self._readers: list[threading.Thread] = []
        self._reading = threading.Lock()
        self._pipes = [os.fdopen(reading, 'rb', buffering=0) for reading, _ in outputs]

    def watch(self) -> None:
        """Start to pass on its lines and to report its end."""
        for pipe, stream in zip(self._pipes, ('stdout', 'stderr'), strict=True):
            self._readers.append(self._thread(self._read, pipe, stream))
        self._thread(self._wait)

    def signal(self, number: signal.Signals) -> bool:
        """Signal the whole process group, if it still exists; returns False if it belongs to another user."""
        try:
            os.killpg(self.pid, number)
        except ProcessLookupError:
            return True
        except PermissionError:
            return False
        return True

    def _thread(self, target: Callable[..., None], *arguments: object) -> threading.Thread:
        thread = threading.Thread(target=target, args=arguments, name=self._plan.name, daemon=True)
        thread.start()
        return thread

    def _read(self, pipe: BinaryIO, stream: str) -> None:
        data, rest, ready = b'-', b'', select.poll()
        ready.register(pipe, select.POLLIN)
        with pipe:
            while data:
                ready.poll()
                with self._reading:  # what was read under this lock has also been shown
                    data = _some_of(pipe)
                    *lines, rest = (rest + data).split(b'\n')
                    if rest and (not data or len(rest) >= _LONGEST_LINE):
                        lines, rest = [*lines, rest], b''
                    for raw in lines:
                        text = raw.decode(errors='replace').rstrip('\r')
                        self._log.take(Line(self._plan.name, text, stream=stream), self._plan.output)

    def _wait(self) -> None:
        code = self._process.wait()
        # A process left in its group would keep the camera or port busy when it is restarted.
        if not orphans.gone(self._group, _GROUP_PATIENCE_S):
            orphans.end(self._group, _ESCALATION)
        self._read_on()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._ended(code)

    def _read_on(self) -> None:
        """Read all that it wrote. Processes that it left running may keep its output open and write on."""
        for reader, pipe in zip(self._readers, self._pipes, strict=True):
            for _ in range(_OUTPUT_LOOKS):
                reader.join(_OUTPUT_PATIENCE_S)
                with self._reading:
                    if not _unread(pipe):
                        break

    def _group(self) -> set[int]:
        return orphans.group(self.pid)


@contextmanager
def _blocked(numbers: set[signal.Signals]) -> Iterator[None]:
    """Within the context, a started process has these signals blocked: it inherits the mask of this thread."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _environment(plan: ProcessPlan, mark: str, folder: Path) -> dict[str, str]:
    # Without a terminal, Python buffers its output, and a killed node would lose its last lines.
    marks = ':'.join(filter(None, [plan.environment.get(orphans.VARIABLE), mark]))
    kept = str(folder / 'kept')  # a launch within a launch keeps its state where the outer one does
    return {'PYTHONUNBUFFERED': '1', KEEP: kept, **plan.environment, orphans.VARIABLE: marks}


def _some_of(pipe: BinaryIO) -> bytes:
    """What is there, or what comes next; nothing at the end."""
    try:
        return pipe.read(_LONGEST_LINE)
    except OSError:  # EIO: the end of a terminal
        return b''


def _unread(pipe: BinaryIO) -> int:
    """How many bytes are waiting to be read; none once the reader has closed the pipe."""
    try:
        return int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), sys.byteorder)
    except (OSError, ValueError):
        return 0


def _close(descriptors: Iterable[int]) -> None:
    for descriptor in descriptors:
        os.close(descriptor)
