"""A program beside a test, and its end together with all that it started."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_END_WITHIN_S = 10.0


class Program:
    """Runs in a process group of its own, as from a terminal, and writes all it says into a file.

    `ros2 run` waits for its child and expects the terminal to send the signal to both: a signal to it alone would leave
    the child behind.
    """

    def __init__(self, words: Sequence[str], said: Path, **options: Any) -> None:
        with said.open('w', encoding='utf-8') as stream:
            self.process = subprocess.Popen(
                words, stdout=stream, stderr=stream, stdin=subprocess.DEVNULL, text=True, start_new_session=True,
                **options,
            )  # fmt: skip

    def send(self, number: int) -> None:
        """To the whole group, as Ctrl-C does; to those of it who are left."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, number)

    def end(self, number: int = signal.SIGINT, within_s: float = _END_WITHIN_S) -> None:
        """Ask it to end, and end what is still there after that."""
        if self.process.poll() is None:
            self.send(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(within_s)
        self.send(signal.SIGKILL)
        self.process.wait()
