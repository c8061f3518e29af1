"""Brings the tip up when the process that commanded the machine is gone.

This file is also a program, which the process starts when the machine is homed. It inherits the open port, so that no
line drops and no controller restarts, and waits at a pipe. A process that ends in order says farewell; when it is gone
without a word (SIGKILL, a crash), the pipe ends, and the program says what brings the tip to the safe height, several
times, because a controller that still moves refuses. It needs nothing but the standard library, so that it starts in
milliseconds, and is deaf to the signals that end a launch.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

_FAREWELL = b'farewell'
_OWN_MARK = 'TACTILE_LAUNCH'  # by which a launch knows what to end; this must outlive it by seconds

ALONE_S, ALONE_TIMES = 0.4, 6
"""Between two attempts, of which one suffices for a controller at rest; the jogs that it was sent end in 0.5 s."""

Step = tuple[float, bytes]
"""How long to wait, and what to say then."""


class DeadMan:
    """The program as the commanding process holds it.

    Args:
        descriptor: of the open port.
        steps: what is said to the controller when nobody else is left to.
    """

    def __init__(self, descriptor: int, steps: Sequence[Step]) -> None:
        words = [word for wait_s, data in steps for word in (str(wait_s), data.hex())]
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', str(Path(__file__)), str(descriptor), *words],
            env={name: value for name, value in os.environ.items() if name != _OWN_MARK},
            cwd='/',
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(descriptor,),
            start_new_session=True,
        )

        self.on_watch = True

    def say_farewell(self) -> None:
        """From now on nothing is said to the controller; returns at once, from any thread."""
        pipe, on_watch, self.on_watch = self._process.stdin, self.on_watch, False
        if on_watch and pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.write(_FAREWELL)
                pipe.close()

    def dismiss(self) -> None:
        """Say farewell, and see the program end."""
        self.say_farewell()
        self._process.wait()


def main(words: Sequence[str]) -> int:
    """Wait for the end of the pipe, and act if it came without farewell."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    descriptor = int(words[0])
    if sys.stdin.buffer.read() == _FAREWELL:
        return 0
    for wait_s, data in zip(words[1::2], words[2::2], strict=True):
        time.sleep(float(wait_s))
        try:
            os.write(descriptor, bytes.fromhex(data))
        except OSError:
            return 1  # the port is gone as well
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
