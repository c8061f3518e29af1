"""The other side of a DDS domain, in a process of its own."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

DEADLINE_S = 90.0


class Other:
    """A program of this folder in a process of its own: `ros_side.py`, or `older_side.py`."""

    def __init__(self, name: str = 'ros_side.py', *words: str) -> None:
        command = [sys.executable, str(Path(__file__).with_name(name)), *words]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if not words:
            self._answer()

    def ask(self, do: str, **what: Any) -> dict[str, Any]:
        self._tell(json.dumps({'do': do, **what}))
        return self._answer()

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + '\n')
        self._process.stdin.flush()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        assert select.select([self._process.stdout], [], [], DEADLINE_S)[0], 'the other side does not answer'
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


class OtherAgain(Other):
    """One after another: each in a process that begins where the imports are done."""

    def __init__(self) -> None:
        super().__init__('ros_side.py', 'again')
        self._pid = 0

    def begin(self, domain: int) -> None:
        self._tell(str(domain))
        self._pid = self._answer()['pid']

    def signal(self, number: int) -> None:
        os.kill(self._pid, number)

    def end_this(self) -> None:
        self.signal(signal.SIGKILL)
        self._answer()
