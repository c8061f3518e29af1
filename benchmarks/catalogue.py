"""All benchmarks, and ``tactile bench`` as their command line.

A benchmark is a module or folder beside this file that declares itself as `BENCHMARK`.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil

import benchmarks
from benchmarks.harness import status
from benchmarks.harness.command import fill
from benchmarks.harness.declaration import Benchmark
from benchmarks.harness.running import run as run_one


def _declared() -> dict[str, Benchmark]:
    names = [each.name for each in pkgutil.iter_modules(benchmarks.__path__) if each.name != 'catalogue']
    modules = [importlib.import_module(f'benchmarks.{name}') for name in names]
    return {each.BENCHMARK.name: each.BENCHMARK for each in modules if hasattr(each, 'BENCHMARK')}


BENCHMARKS = _declared()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add a subcommand for each benchmark, and one for the state of their results."""
    commands = parser.add_subparsers(dest='benchmark', required=True, metavar='benchmark')
    raw = argparse.RawDescriptionHelpFormatter
    status.add_arguments(
        commands.add_parser('status', help=status.HELP, description=status.__doc__, formatter_class=raw)
    )
    for each in BENCHMARKS.values():
        fill(commands.add_parser(each.name, help=each.help, description=each.about, formatter_class=raw), each)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen subcommand."""
    if arguments.benchmark == 'status':
        return status.run(arguments, list(BENCHMARKS.values()))
    return run_one(BENCHMARKS[arguments.benchmark], arguments)
