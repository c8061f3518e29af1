"""The state of the results in docs/results: at which commit each was measured, and what has changed since.

A result is stale if a source that its benchmark names has changed since then. It may still hold, but is worth measuring
again. A check finds what is broken: missing files, files that no benchmark names, sources that do not exist, and pages
that differ from their JSON file.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.harness.declaration import Benchmark
from benchmarks.harness.history import commits_since, limits
from benchmarks.harness.running import parted, read
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory

HELP = 'list the results in docs/results: at which commit each was measured, and whether its sources changed since'
RESULTS = Path('docs') / 'results'
UNKNOWN, FRESH, STALE = 'unknown', 'fresh', 'stale'
INDEX = 'README.md'
SHORT = 7  # least number of a commit's digits on a page
LINE = '{:<36}{:<20}{:>7}  {:<9}{}'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tactile bench status``."""
    parser.add_argument(
        '--check', action='store_true', help='also look for broken results; the exit status is 1 if there are any'
    )
    parser.epilog = 'examples:\n  tactile bench status\n  tactile bench status --check'


def run(arguments: argparse.Namespace, benchmarks: Sequence[Benchmark], root: Path | None = None) -> int:
    """List the results, and check them if requested; a stale result is no fault."""
    root = root or share_directory()
    print(listing(root, benchmarks))
    problems = list(check(root, benchmarks)) if arguments.check else []
    if arguments.check:
        print('\n' + ('\n'.join(f'wrong: {problem}' for problem in problems) or 'nothing is wrong'))
    return int(bool(problems))


@dataclass(frozen=True)
class Age:
    """The age of a result: its commit, how many commits have changed its sources since, and the changed sources."""

    result: str
    commit: str
    commits: int | None
    changed: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """The state in one word."""
        if self.commits is None:
            return UNKNOWN
        return STALE if self.commits else FRESH


def listing(root: Path, benchmarks: Sequence[Benchmark]) -> str:
    """One line per result; missing history is reported above."""
    ages = [age_of(root, each, file) for each in benchmarks for file in _results(each)]
    lines = [LINE.format('result', 'measured at', 'commits', 'state', 'sources changed since'), *map(_line, ages)]
    return '\n\n'.join(filter(None, [limits(root), '\n'.join(map(str.rstrip, lines))]))


def _line(age: Age) -> str:
    count = '–' if age.commits is None else str(age.commits)
    return LINE.format(age.result, age.commit or UNKNOWN, count, age.state, ', '.join(age.changed))


def _results(benchmark: Benchmark) -> Iterator[str]:
    """The JSON files, and pages without a JSON file."""
    names = {Path(file).with_suffix(''): file for file in benchmark.published if file.endswith('.md')}
    names |= {Path(file).with_suffix(''): file for file in benchmark.published if file.endswith('.json')}
    yield from names.values()


def age_of(root: Path, benchmark: Benchmark, file: str) -> Age:
    """The age of one result; if its parts have different commits, the age of the oldest part."""
    commits = _commits(_read(root / RESULTS / file)) if file.endswith('.json') else []
    ages = [_age(root, benchmark, file, commit) for commit in dict.fromkeys(commits)]
    known = [age for age in ages if age.commits is not None]
    return max(known or ages, key=lambda age: age.commits or 0, default=Age(file, '', None))


def _age(root: Path, benchmark: Benchmark, file: str, commit: str) -> Age:
    bare = commit.removesuffix('-dirty')
    changed = tuple(source for source in benchmark.sources if commits_since(root, bare, [source]))
    return Age(file, commit, commits_since(root, bare, benchmark.sources), changed)


def _read(file: Path) -> dict[str, Any]:
    """A result; empty if it cannot be read, which `check` reports."""
    try:
        return read(file, missing={})
    except ConfigurationError:
        return {}


def _commits(found: Any) -> list[str]:
    """All commits in a result, its own and those of its parts."""
    if not isinstance(found, dict):
        return []
    own = [found['commit']] if isinstance(found.get('commit'), str) else []
    return [*own, *(commit for each in found.values() for commit in _commits(each))]


def check(root: Path, benchmarks: Sequence[Benchmark]) -> Iterator[str]:
    """The faults of the results, as sentences."""
    for each in benchmarks:
        yield from (f'{RESULTS / file} of {each.name} is missing' for file in each.published if not _there(root, file))
        for source in each.sources:
            if next(root.glob(source), None) is None:
                yield f'{each.name} names {source} as a source, and there is none'
        for file in each.published:
            if file.endswith('.json') and _there(root, file):
                yield from _disagreement(root, root / RESULTS / file, each)
    yield from _unclaimed(root, benchmarks)


def _there(root: Path, file: str) -> bool:
    return (root / RESULTS / file).is_file()


def _unclaimed(root: Path, benchmarks: Sequence[Benchmark]) -> Iterator[str]:
    claimed = {file for each in benchmarks for file in each.published}
    for file in sorted((root / RESULTS).rglob('*.*')):
        name = file.relative_to(root / RESULTS).as_posix()
        if name not in claimed and file.name != INDEX:
            yield f'{RESULTS / name} is of no benchmark that is known; name it among the files of one, or remove it'


def _disagreement(root: Path, file: Path, benchmark: Benchmark) -> Iterator[str]:
    """Report a page that differs from its JSON file; a page by a person must name one of the commits instead."""
    page, shown = file.with_suffix('.md'), file.relative_to(root)
    try:
        result = read(file)
        if not page.is_file():
            return
        text = page.read_text(encoding='utf-8')
        if benchmark.by_hand or benchmark.more_than_json:
            agrees = not (commits := _commits(result)) or any(each[:SHORT] in text for each in commits)
            complaint = f'names none of the commits of {file.name}; say at which it was measured'
        else:
            agrees = parted(text)[0] == benchmark.page(result).rstrip()
            complaint = (
                f'says another thing than {file.name}; renew it with: tactile bench {benchmark.name} --redraw {shown}'
            )
    except (ConfigurationError, KeyError, TypeError, ValueError) as error:
        agrees, complaint = False, f'cannot be compared with {file.name}: {error!r}'
    if not agrees:
        yield f'{page.relative_to(root)} {complaint}'
