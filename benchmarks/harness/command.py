"""The command line of a benchmark: its parser, and the command shown on a page."""

from __future__ import annotations

import argparse
import os
import shlex
from pathlib import Path
from typing import Any

from benchmarks.harness.declaration import Benchmark
from tactile_nodes.errors import ConfigurationError

LEFT_OUT = 'help', 'redraw', 'processes', 'on'


def parser_of(benchmark: Benchmark) -> argparse.ArgumentParser:
    """A parser for one benchmark; `fill` adds the same arguments to a subcommand."""
    parser = argparse.ArgumentParser(prog=f'tactile bench {benchmark.name}')
    fill(parser, benchmark)
    return parser


def fill(parser: argparse.ArgumentParser, benchmark: Benchmark) -> None:
    """Add the arguments of one benchmark, then the common ones."""
    for each in benchmark.arguments:
        parser.add_argument(*each.names, **each.options)
    if benchmark.cases:
        parser.add_argument(
            '--only', nargs='+', action='extend', choices=benchmark.cases, metavar='NAME',
            help=f'run only these cases, of: {", ".join(benchmark.cases)} (default: all)',
        )  # fmt: skip
    if benchmark.seed is not None:
        parser.add_argument('--seed', type=int, default=benchmark.seed, help='random seed (default: %(default)s)')
    if benchmark.quick:
        parser.add_argument(
            '--quick', action='store_true', help='a short run, to see that it works; do not quote its numbers'
        )
    if benchmark.tasks:
        parser.add_argument(
            '--processes', type=int, default=len(os.sched_getaffinity(0)), metavar='N',
            help='number of parallel processes on this machine (default: one per processor)',
        )  # fmt: skip
        parser.add_argument(
            '--on',
            default='',
            metavar='tcp://HOST:8786',
            help='run on a Dask cluster that was started in this checkout with PYTHONPATH=. (docs/training.md)',
        )
    _add_files(parser, benchmark)
    parser.epilog = benchmark.example or f'example: tactile bench {benchmark.name}'


def _add_files(parser: argparse.ArgumentParser, benchmark: Benchmark) -> None:
    if not benchmark.keeps:
        return
    ends = ['.json', *([] if benchmark.by_hand else ['.md']), *(['.png'] if benchmark.draw else [])]
    default = f' (default: {benchmark.output})' if benchmark.output else ''
    parser.add_argument(
        '-o', '--output', type=Path, default=benchmark.output, metavar='FOLDER',
        help=f'folder for {benchmark.name}{", ".join(ends)}, or the name of the JSON file{default}',
    )  # fmt: skip
    if not (benchmark.by_hand or benchmark.more_than_json):
        parser.add_argument(
            '--redraw',
            type=Path,
            metavar='FILE.json',
            help='write page and charts again beside this result, without measuring (-o is not used)',
        )


def check(benchmark: Benchmark, given: argparse.Namespace) -> None:
    """Check the limits of all numbers.

    Raises:
        ConfigurationError: a number is out of its limits.
    """
    for each in benchmark.arguments:
        name = each.names[-1]
        value = getattr(given, name.lstrip('-').replace('-', '_'))
        for number in value if isinstance(value, list) else [value]:
            if each.least is not None and number is not None and not number >= each.least:
                raise ConfigurationError(f'{name} must be at least {each.least:g}, got {number:g}')
            if each.above is not None and number is not None and not number > each.above:
                raise ConfigurationError(f'{name} must be above {each.above:g}, got {number:g}')


def command_of(parser: argparse.ArgumentParser, arguments: argparse.Namespace, words: str) -> str:
    """The command with all arguments that differ from the default; files outside this folder appear by name only."""
    parts = [words]
    for action in parser._actions:
        value = getattr(arguments, action.dest, action.default)
        if action.dest in LEFT_OUT or value == action.default or value in (None, []):
            continue
        if action.option_strings:
            parts.append(max(action.option_strings, key=len) if action.dest != 'output' else '-o')
        if action.nargs != 0:
            parts += [shlex.quote(_word(each)) for each in (value if isinstance(value, (list, tuple)) else [value])]
    return ' '.join(parts)


def _word(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:g}'
    return value.name if isinstance(value, Path) and value.is_absolute() else str(value)
