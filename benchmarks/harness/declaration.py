"""What a benchmark says of itself; all else is done for it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.harness.report import table

if TYPE_CHECKING:
    from benchmarks.harness.running import Run

Result = dict[str, Any]
"""Plain data, as the JSON file holds it."""
Told = Mapping[str, Any]
Part = Callable[[str, Callable[[], Any]], Any]
"""Gives a part of a long run by its name: what was kept of it, or what the function measures."""


def at_once(_: str, make: Callable[[], Any]) -> Any:
    """Nothing was kept, and nothing is."""
    return make()


SENSING = 'tactile_nodes/sensing/**', 'tactile_nodes/pipeline/**', 'tactile_nodes/*.py', 'models/**'
SIMULATED = 'tactile_nodes/simulation/**', 'tactile_nodes/contact_tables/**'
RIG = 'tactile_nodes/collection/**', 'tactile_nodes/drivers/**', 'tactile_nodes/emulators/**'
LIVE = *SENSING, 'tactile_nodes/nodes/**', 'tactile_nodes/bus/**', 'launch/**'


@dataclass(frozen=True)
class Argument:
    """One argument of a command line, as `argparse` takes it, and the least number that means anything."""

    names: tuple[str, ...]
    options: Mapping[str, Any]
    least: float | None = None
    above: float | None = None


def argument(*names: str, least: float | None = None, above: float | None = None, **options: Any) -> Argument:
    """An argument of one benchmark; those that many have need none."""
    return Argument(names, options, least, above)


@dataclass(frozen=True)
class Aim:
    """A figure with a target.

    `reached` gives the measured values by column: one column for each contender, or a single one.
    """

    figure: str
    to_reach: str
    reached: Callable[[Told], Mapping[str, str]]


def reached(aims: Sequence[Aim], result: Told) -> str:
    """A table of targets and measured values, with a row for each aim that this result has values for."""
    told = [(aim, found) for aim in aims if (found := aim.reached(result))]
    columns = list(dict.fromkeys(column for _, found in told for column in found))
    rows = [[aim.figure, aim.to_reach, *(found.get(column, '–') for column in columns)] for aim, found in told]
    return table(['figure', 'target', *columns], rows)


def _never(_: Told) -> bool:
    return False


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        about: what it does, first in a sentence: the docstring of its module.
        sources: what its result depends on, as paths from the root of the repository; `**` is any folders.
        page: what is printed; unless `by_hand` also the page beside the JSON file, in Markdown.
        measure: of the arguments to a result. Of a benchmark `in_parts` that of one case, and each part is measured,
            kept and dated by itself.
        tasks: its parts are tasks, for processes of this machine (``--processes``) or a cluster (``--on``): the cases
            of a benchmark `in_parts`, else those that it gives to `Run.parts` or `Run.made`.
        arguments: those that no other benchmark has; cases: what ``--only`` chooses from.
        seed, quick: whether it takes ``--seed`` (and what it is by default) and ``--quick``.
        draw: writes charts into a folder; their names begin with that of the result.
        failed: whether the exit status says that something is wrong.
        name_of: of the files that are written, where other arguments make another result.
        files: what stands in docs/results of it; by default NAME.json, its page, and its chart if it draws one.
        keeps: whether ``-o`` keeps the result as JSON; what is read of recordings is printed alone.
        by_hand: a person writes the page around what is printed.
        more_than_json: the page tells what the JSON file does not hold (keys of the result that begin with `_`), so it
            cannot be made of that again.
        output: where files go unless ``-o`` says so; None: nowhere.
    """

    name: str
    about: str | None
    sources: tuple[str, ...]
    page: Callable[[Told], str]
    measure: Callable[[argparse.Namespace, Run], Result]
    arguments: tuple[Argument, ...] = ()
    cases: tuple[str, ...] = ()
    in_parts: bool = False
    tasks: bool = False
    seed: int | None = None
    quick: bool = False
    draw: Callable[[Told, Path, str], None] | None = None
    failed: Callable[[Told], bool] = _never
    name_of: Callable[[argparse.Namespace], str] | None = None
    files: tuple[str, ...] | None = None
    keeps: bool = True
    by_hand: bool = False
    more_than_json: bool = False
    output: Path | None = None
    example: str = ''

    @property
    def help(self) -> str:
        """Its first sentence, for lists."""
        return ' '.join((self.about or '').partition('\n\n')[0].split())

    @property
    def published(self) -> tuple[str, ...]:
        """What stands in docs/results of it."""
        if self.files is not None:
            return self.files
        return (f'{self.name}.json', f'{self.name}.md', *([f'{self.name}.png'] if self.draw else []))
