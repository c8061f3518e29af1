"""A benchmark run: from its command line to numbers, page and charts in a folder."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.harness.command import LEFT_OUT, check, command_of, parser_of
from benchmarks.harness.declaration import Benchmark, Result
from benchmarks.harness.parts import Parts
from benchmarks.harness.report import surroundings
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress, TerminalProgress
from tactile_nodes.learning.tasks import Job, done, on_cluster

NOTES = '## Notes'
Made = TypeVar('Made')


class Run:
    """The harness as seen by a benchmark's `measure`.

    Attributes:
        command: the command shown on a page.
        cases: the cases chosen by ``--only``.
        progress: progress bars and lines for the user.
        folder: folder of the result; None: it is only printed.
    """

    def __init__(self, benchmark: Benchmark, arguments: argparse.Namespace, progress: Progress | None = None) -> None:
        self.benchmark, self.progress = benchmark, progress or TerminalProgress()
        self.command = command_of(parser_of(benchmark), arguments, f'tactile bench {benchmark.name}')
        chosen = benchmark.cases and getattr(arguments, 'only', None)
        self.cases: tuple[str, ...] = tuple(chosen or benchmark.cases)
        self.folder, self.name = _place(benchmark, arguments)
        self.about = {} if benchmark.in_parts else surroundings(self.command)
        options = {key: value for key, value in vars(arguments).items() if key not in {'output', *LEFT_OUT}}
        self._processes: int = getattr(arguments, 'processes', 1)
        self._parts = Parts.of(benchmark.name, options)

    def part(self, name: str, make: Callable[[], Any]) -> Any:
        """A part of a long run, as plain JSON data: measured now, or before the run was killed."""
        before = self._parts.found
        found = self._parts.get(name, make)
        if self._parts.found > before:
            self.progress.say(f'{name}: as it was measured before the run was ended')
        return found

    def parts(self, make: Callable[[Job], Any], jobs: Mapping[str, Job], title: str) -> dict[str, Any]:
        """Parts that are tasks: `make` is called with each job, in another process or on another machine."""
        found = {name: kept for name in jobs if (kept := self._parts.kept(name)) is not None}
        missing = [name for name in jobs if name not in found]
        with self.progress.bar(title, len(jobs)) as bar:
            bar.advance(len(found))
            for number, measured in done(make, [jobs[name] for name in missing], self._processes) if missing else ():
                found[missing[number]] = self._parts.keep(missing[number], measured)
                bar.advance(1, missing[number])
        return {name: found[name] for name in jobs}

    def made(self, make: Callable[[Job], Made], jobs: Mapping[str, Job], title: str) -> list[Made]:
        """The result of `make` for each job, as tasks; nothing is stored."""
        found: dict[int, Made] = {}
        with self.progress.bar(title, len(jobs)) as bar:
            for number, each in done(make, list(jobs.values()), self._processes):
                found[number] = each
                bar.advance(1, list(jobs)[number])
        return [found[number] for number in range(len(jobs))]

    def cases_of(self, jobs: Sequence[tuple[Benchmark, argparse.Namespace]]) -> Iterator[tuple[int, Result]]:
        """Each case with its number, as soon as it is measured: one after another here, or as tasks."""
        if not self.benchmark.tasks:
            yield from ((number, _case(job, self)) for number, job in enumerate(jobs))
            return
        with self.progress.bar(self.benchmark.name, len(jobs)) as bar:
            for number, measured in done(_case, jobs, self._processes):
                bar.advance(1, self.cases[number])
                yield number, measured

    def earlier(self) -> Result:
        """The existing result that this run will replace.

        Raises:
            ConfigurationError: it cannot be read.
        """
        return {} if self.folder is None else read(self.folder / f'{self.name}.json', missing={})

    def keep(self, measured: Mapping[str, Any]) -> Result:
        """The whole result; written if there is a folder. A run in steps calls this after each step."""
        result = {**self.about, **measured}
        if self.folder is not None:
            write(self.benchmark, result, self.folder, self.name)
        return result

    def end(self) -> None:
        """Delete the stored parts, after the result is written."""
        self._parts.forget()


def run(benchmark: Benchmark, arguments: argparse.Namespace) -> int:
    """Measure, print and store, or draw a stored result again; returns 1 if the benchmark reports a failure."""
    if getattr(arguments, 'redraw', None):
        result = redraw(benchmark, arguments.redraw)
    else:
        check(benchmark, arguments)
        running = Run(benchmark, arguments)
        with on_cluster(getattr(arguments, 'on', '')):
            result = _measured(benchmark, arguments, running)
        running.end()
    print(benchmark.page(result))
    return int(benchmark.failed(result))


def _measured(benchmark: Benchmark, arguments: argparse.Namespace, running: Run) -> Result:
    if not benchmark.in_parts:
        return running.keep(benchmark.measure(arguments, running))
    result = running.earlier()
    chosen = [argparse.Namespace(**{**vars(arguments), 'only': [case]}) for case in running.cases]
    for number, measured in running.cases_of([(benchmark, each) for each in chosen]):
        result[running.cases[number]] = measured
        running.keep(result)
    return result


def _case(job: tuple[Benchmark, argparse.Namespace], running: Run | None = None) -> Result:
    """One case of a benchmark in parts, with its surroundings; in another process without progress bars."""
    benchmark, chosen = job
    about = surroundings(command_of(parser_of(benchmark), chosen, f'tactile bench {benchmark.name}'))
    return {**about, **benchmark.measure(chosen, running or Run(benchmark, chosen, Progress()))}


def redraw(benchmark: Benchmark, file: Path) -> Result:
    """Write page and charts of a stored result beside it; nothing is measured.

    Raises:
        ConfigurationError: there is no result, or it belongs to another benchmark.
    """
    result = read(file)
    try:
        write(benchmark, result, file.parent, file.stem)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f'{file} is no result of {benchmark.name}, or one of an older form ({error})'
        ) from error
    return result


def read(file: Path, missing: Result | None = None) -> Result:
    """A stored result; `missing` if there is none.

    Raises:
        ConfigurationError: it cannot be read, or is no result.
    """
    try:
        found = json.loads(file.read_text(encoding='utf-8'))
    except FileNotFoundError as error:
        if missing is not None:
            return missing
        raise ConfigurationError(f'there is no result {file}; measure it first, with -o {file.parent}') from error
    except (OSError, ValueError) as error:
        raise ConfigurationError(f'cannot read the result {file} ({error}); take it away') from error
    if not isinstance(found, dict):
        raise ConfigurationError(f'{file} is no result of a benchmark')
    return found


def write(benchmark: Benchmark, result: Result, folder: Path, name: str) -> None:
    """Write NAME.json, the page NAME.md unless a person writes it, and charts; creates the folder if necessary.

    Notes that a person has added at the end of the page are kept.

    Raises:
        ConfigurationError: it cannot be written.
    """
    plain = {key: value for key, value in result.items() if not key.startswith('_')}
    files = {f'{name}.json': json.dumps(plain, indent=1)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not benchmark.by_hand:
            page = folder / f'{name}.md'
            _, notes = parted(page.read_text(encoding='utf-8')) if page.is_file() else ('', '')
            files[page.name] = '\n\n'.join(filter(None, [benchmark.page(result), notes]))
        for file, text in files.items():
            (folder / file).write_text(f'{text}\n', encoding='utf-8')
    except OSError as error:
        raise ConfigurationError(f'cannot write to {folder} ({error.strerror}); choose another with -o') from error
    if benchmark.draw:
        benchmark.draw(result, folder, name)


def parted(page: str) -> tuple[str, str]:
    """The two parts of a page: written by the benchmark, and the notes that a person has added at its end."""
    written, mark, notes = page.partition(NOTES)
    return written.rstrip(), (mark + notes).rstrip()


def _place(benchmark: Benchmark, arguments: argparse.Namespace) -> tuple[Path | None, str]:
    """The folder and the name of a result; ``-o`` names a folder or the JSON file."""
    output = getattr(arguments, 'output', None)
    name = benchmark.name_of(arguments) if benchmark.name_of else benchmark.name
    if output is not None and output.suffix == '.json':
        return output.parent, output.stem
    return output, name
