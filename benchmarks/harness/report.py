"""Common content of all reports, and functions that summarize and format numbers."""

from __future__ import annotations

import importlib.metadata
import math
import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np

from benchmarks.harness.history import describe
from tactile_nodes.learning.evaluation.text_table import Table
from tactile_nodes.paths import share_directory

T = TypeVar('T')
_PACKAGES = ('numpy', 'pyzmq', 'rosbags', 'opencv-contrib-python-headless')


def surroundings(command: str) -> dict[str, Any]:
    """Machine, load, versions and commit; measured times need them."""
    return {
        'command': command,
        'machine': {
            'processor': _processor(),
            'cores': os.cpu_count(),
            'cores_allowed': len(os.sched_getaffinity(0)),
            'system': platform.platform(),
            'load_before': [round(load, 2) for load in os.getloadavg()],
        },
        'versions': {'python': platform.python_version(), **_versions()},
        'commit': _commit(),
    }


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """Median, p90 and p99."""
    return {f'p{level}': float(np.percentile(values, level)) for level in (50, 90, 99)}


def spread(values: Sequence[float]) -> dict[str, float]:
    """Median and range over the rounds of a run."""
    return {'median': float(np.median(values)), 'low': float(min(values)), 'high': float(max(values))}


def quartiles(values: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Median and quartiles; NaN without values. On a shared machine, extremes come from other programs."""
    low, median, high = np.percentile(values, (25, 50, 75)).tolist() if len(values) else 3 * [math.nan]
    return {'median': median, 'low': low, 'high': high}


def ranged(found: Mapping[str, float]) -> str:
    """'1.20 (1.10 to 1.40)' from the result of `quartiles` or `spread`."""
    return f'{found["median"]:.2f} ({found["low"]:.2f} to {found["high"]:.2f})'


def in_turn(contenders: Sequence[T], number: int) -> Sequence[T]:
    """The order of the contenders in a round; it is reversed in every other round.

    So other load on the machine, and caches filled by the previous contender, affect all of them.
    """
    return contenders[:: -1 if number % 2 else 1]


def opening(title: str, result: Mapping[str, Any], introduction: str, more: str = '') -> list[str]:
    """The beginning of every page: title, command, introduction, and the machine."""
    about = '; '.join(filter(None, [machine_and_commit(result), named_versions(result), more]))
    return [f'# {title}', f'```console\n$ {result["command"]}\n```', introduction.strip(), f'{about}.']


def machine_and_commit(result: Mapping[str, Any]) -> str:
    """'AMD EPYC, 2 cores, load before 0.4; commit c0ffee' from the result of `surroundings`."""
    machine = result['machine']
    return (
        f'{machine["processor"]}, {machine["cores_allowed"]} cores, load before {machine["load_before"][0]}; commit '
        f'{result["commit"]}'
    )


def named_versions(result: Mapping[str, Any]) -> str:
    """'python 3.11.7, numpy 2.4.6' from the result of `surroundings`."""
    return ', '.join(f'{name} {version}' for name, version in result['versions'].items())


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table with aligned columns: the first to the left, the others to the right."""
    return Table('', tuple(heads), tuple(map(tuple, rows))).markdown()


Cell: TypeAlias = 'str | Callable[[Mapping[str, Any]], str]'


def columns(entries: Iterable[Mapping[str, Any]], *cells: tuple[str, Cell]) -> str:
    """A table with one row per entry. A column is its head, and a format for the entry's items or a function of it.

    >>> print(columns([{'name': 'fast', 'ms': {'p50': 1.26}}], ('model', '{name}'), ('p50 [ms]', '{ms[p50]:.1f}')))
    | model | p50 [ms] |
    | ----- | -------: |
    | fast  |      1.3 |
    """
    rows = [[cell.format(**each) if isinstance(cell, str) else cell(each) for _, cell in cells] for each in entries]
    return table([head for head, _ in cells], rows)


def shown(value: float | None, form: str, none: str = '–') -> str:
    """A number in a format such as '{:.2f} s'; a dash for None or NaN."""
    return none if value is None or math.isnan(value) else form.format(value)


def named(entries: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Entries with their names added."""
    return [{'name': name, **each} for name, each in entries.items()]


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(':')[2].strip() for line in lines if line.startswith('model name')), platform.machine())


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # some of them are optional
            continue
    return found


def _commit() -> str:
    return describe(share_directory()) or importlib.metadata.version('tactile_nodes')
