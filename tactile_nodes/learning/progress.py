"""Progress of long tasks: a bar on a terminal, or no output."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Bar:
    """One task in progress. `show` gets the number of finished steps, and a text for a line under the bar."""

    def __init__(self, show: Callable[[int, str], None] = lambda *_: None) -> None:
        self._show = show

    def advance(self, steps: int = 1, text: str = '') -> None:
        """Count finished steps."""
        self._show(steps, text)


class Progress:
    """Shows nothing: for tests and for use as a library."""

    @contextmanager
    def bar(self, title: str, steps: int) -> Iterator[Bar]:
        """A bar that is shown while the block runs."""
        del title, steps
        yield Bar()

    def say(self, text: str) -> None:
        """Show one line to the user."""


class TerminalProgress(Progress):
    """Bars with the remaining time, drawn by rich."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(highlight=False)

    @contextmanager
    def bar(self, title: str, steps: int) -> Iterator[Bar]:
        from rich.console import Group
        from rich.live import Live
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Rich
        from rich.text import Text

        rich = Rich(
            TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
            TimeElapsedColumn(), TextColumn('left'), TimeRemainingColumn(),
        )  # fmt: skip
        below = Text()
        task = rich.add_task(title, total=steps)

        def show(done: int, text: str) -> None:
            rich.advance(task, done)
            below.plain = text

        # The text of a step has its own line: an 80 column terminal has no room for it beside the bar.
        try:
            with Live(Group(rich, below), console=self._console):
                yield Bar(show)
        finally:
            if not self._console.is_terminal:
                self._console.print()

    def say(self, text: str) -> None:
        self._console.print(text, markup=False, soft_wrap=True)
