"""What long work says and how far it is, and Ctrl-C in the midst of it."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

from tactile_nodes.learning.progress import Progress


class Told(Progress):
    """Keeps the lines, and the texts of the steps; Ctrl-C comes with a step, if one is named."""

    def __init__(self, ctrl_c_at: int = 10**9) -> None:
        self.lines: list[str] = []
        self.steps: list[str] = []
        self._ctrl_c_at = ctrl_c_at

    def bar(self, title: str, steps: int) -> AbstractContextManager[Any]:
        return nullcontext(self)

    def advance(self, steps: int = 1, text: str = '') -> None:
        self.steps.append(text)
        if len(self.steps) >= self._ctrl_c_at:
            raise KeyboardInterrupt

    def say(self, text: str) -> None:
        self.lines.append(text)
