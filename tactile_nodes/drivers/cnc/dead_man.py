"""Dead man's switch: lifts the tip when the process that commanded the machine has ended.

This file is also a program, which the process starts when the machine is homed. It inherits the open port, so that no
control line changes and no controller restarts, and waits on a pipe. A process that ends normally kills it first.
If the process ends otherwise (SIGKILL, a crash), the pipe closes, and the program sends the commands that lift the tip
to the safe height, several times, because a controller that still moves refuses them. It uses only the standard
library, so it starts within milliseconds, and it ignores the signals that end a launch.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

_OWN_MARK = 'TACTILE_LAUNCH'  # the mark of processes that a launch ends; this one must outlive it by seconds

ALONE_S, ALONE_TIMES = 0.4, 6
"""Time between attempts, and their number. One is enough at rest; jogs that were sent before end within 0.5 s."""

Step = tuple[float, bytes]
"""How long to wait, and what to send then."""


class DeadMan:
    """The program, as seen by the commanding process.

    Args:
        descriptor: of the open port.
        steps: sent to the controller when the commanding process has ended.
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
        """Keep the program from acting; returns at once, from any thread."""
        self.on_watch = False
        self._process.kill()

    def dismiss(self) -> None:
        """Keep the program from acting, and wait until it has ended and let go of the port."""
        self.say_farewell()
        self._process.communicate()


def main(words: Sequence[str]) -> int:
    """Wait until the pipe closes, and act."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    descriptor = int(words[0])
    sys.stdin.buffer.read()
    for wait_s, data in zip(words[1::2], words[2::2], strict=True):
        time.sleep(float(wait_s))
        try:
            os.write(descriptor, bytes.fromhex(data))
        except OSError:
            return 1  # the port is gone too
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
