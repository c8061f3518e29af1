"""The other side of a DDS domain, in a process of its own."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from pathlib import Path
from typing import Any

DEADLINE_S = 90.0


class Other:
    """A program of this folder in a process of its own: `ros_side.py`, or `older_side.py`."""

    def __init__(self, name: str = 'ros_side.py') -> None:
        program = Path(__file__).with_name(name)
        self._process = subprocess.Popen(
            [sys.executable, str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._answer()

    def ask(self, do: str, **what: Any) -> dict[str, Any]:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({'do': do, **what}) + '\n')
        self._process.stdin.flush()
        return self._answer()

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
