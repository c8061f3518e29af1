"""Progress of long work: a bar on a terminal, or silence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable


@runtime_checkable
class Bar(Protocol):
    """One piece of work under way."""

    def advance(self, steps: int = 1, text: str = '') -> None:
        """Count finished steps; `text` is shown beside the bar."""
        ...


class Progress:
    """Shows nothing: for tests and for use as a library."""

    @contextmanager
    def bar(self, title: str, steps: int) -> Iterator[Bar]:
        """A bar for as long as the block runs."""
        del title, steps
        yield _Silence()

    def say(self, text: str) -> None:
        """One line for the person who waits."""


class TerminalProgress(Progress):
    """Bars with the time left, drawn by rich."""

    @contextmanager
    def bar(self, title: str, steps: int) -> Iterator[Bar]:
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Rich

        columns = (
            TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn('left'), TimeRemainingColumn(), TextColumn('{task.fields[text]}'),
        )  # fmt: skip
        with Rich(*columns) as rich:
            yield _RichBar(rich, rich.add_task(title, total=steps, text=''))

    def say(self, text: str) -> None:
        from rich.console import Console

        Console(highlight=False).print(text, markup=False, soft_wrap=True)


class _Silence:
    def advance(self, steps: int = 1, text: str = '') -> None:
        pass


class _RichBar:
    def __init__(self, rich: object, task: object) -> None:
        self._rich = rich
        self._task = task

    def advance(self, steps: int = 1, text: str = '') -> None:
        self._rich.update(self._task, advance=steps, text=text)  # type: ignore[attr-defined]
