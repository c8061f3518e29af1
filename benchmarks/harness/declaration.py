"""The declaration of a benchmark; the harness does everything else."""

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
"""Plain data, as in the JSON file."""
ResultFields = Mapping[str, Any]
Part = Callable[[str, Callable[[], Any]], Any]
"""Returns a part of a long run by its name: the stored one, or a new one from the function."""


def at_once(_: str, make: Callable[[], Any]) -> Any:
    """Measure a part without storing it."""
    return make()


SENSING = 'tactile_nodes/sensing/**', 'tactile_nodes/pipeline/**', 'tactile_nodes/*.py', 'models/**'
SIMULATED = 'tactile_nodes/simulation/**', 'tactile_nodes/contact_tables/**'
RIG = 'tactile_nodes/collection/**', 'tactile_nodes/drivers/**', 'tactile_nodes/emulators/**'
LIVE = *SENSING, 'tactile_nodes/nodes/**', 'tactile_nodes/bus/**', 'launch/**'


@dataclass(frozen=True)
class Argument:
    """One argument for `argparse`; a number must be at least `least`, and larger than `above`."""

    names: tuple[str, ...]
    options: Mapping[str, Any]
    least: float | None = None
    above: float | None = None


def argument(*names: str, least: float | None = None, above: float | None = None, **options: Any) -> Argument:
    """Declare an argument of one benchmark; the common arguments need no declaration."""
    return Argument(names, options, least, above)


@dataclass(frozen=True)
class Aim:
    """A figure with a target.

    `reached` gives the measured values by column: one column for each contender, or a single one.
    """

    figure: str
    to_reach: str
    reached: Callable[[ResultFields], Mapping[str, str]]


def reached(aims: Sequence[Aim], result: ResultFields) -> str:
    """A table of targets and measured values, with a row for each aim that this result has values for."""
    aim_columns = [(aim, found) for aim in aims if (found := aim.reached(result))]
    columns = list(dict.fromkeys(column for _, found in aim_columns for column in found))
    rows = [[aim.figure, aim.to_reach, *(found.get(column, '–') for column in columns)] for aim, found in aim_columns]
    return table(['figure', 'target', *columns], rows)


def _never(_: ResultFields) -> bool:
    return False


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        about: the docstring of its module; its first sentence is the summary.
        sources: paths, from the root of the repository, that its result depends on; `**` is any folders.
        page: makes the printed text; unless `by_hand` it is also the page in Markdown beside the JSON file.
        measure: from the arguments to a result. If `in_parts`, the result of one case; each part is then measured,
            stored and dated separately.
        tasks: its parts are tasks for processes of this machine (``--processes``) or a cluster (``--on``): the cases
            of a benchmark `in_parts`, else those passed to `Run.parts` or `Run.made`.
        arguments: its own arguments; cases: the choices of ``--only``.
        seed, quick: whether it has ``--seed`` (and its default) and ``--quick``.
        draw: writes charts into a folder; their names begin with that of the result.
        failed: whether the exit status reports a failure.
        name_of: the name of the files, if other arguments give another result.
        files: its files in docs/results; by default NAME.json, its page, and its chart if it draws one.
        keeps: whether ``-o`` stores the result as JSON; results of evaluated recordings are only printed.
        by_hand: a person writes the page around the printed text.
        more_than_json: the page has content that is not in the JSON file (keys of the result that begin with `_`), so
            it cannot be made from that file again.
        output: the folder for files without ``-o``; None: no files.
    """

    name: str
    about: str | None
    sources: tuple[str, ...]
    page: Callable[[ResultFields], str]
    measure: Callable[[argparse.Namespace, Run], Result]
    arguments: tuple[Argument, ...] = ()
    cases: tuple[str, ...] = ()
    in_parts: bool = False
    tasks: bool = False
    seed: int | None = None
    quick: bool = False
    draw: Callable[[ResultFields, Path, str], None] | None = None
    failed: Callable[[ResultFields], bool] = _never
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
        """Its files in docs/results."""
        if self.files is not None:
            return self.files
        return (f'{self.name}.json', f'{self.name}.md', *([f'{self.name}.png'] if self.draw else []))
