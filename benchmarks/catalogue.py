"""All benchmarks, and ``tactile bench`` as their command line."""

from __future__ import annotations

import argparse

from benchmarks import (
    accuracy,
    bus,
    collection,
    contacts,
    dds,
    drift,
    drivers,
    endurance,
    faults,
    fingers,
    firmware,
    flow,
    front,
    latency,
    motion,
    page,
    runtimes,
    stability,
    stopping,
    system_faults,
    take_over,
    transfer,
    transfer_paper,
    transfer_partial,
    untouched,
)
from benchmarks.harness import status
from benchmarks.harness.command import fill
from benchmarks.harness.running import run as run_one

MODULES = (
    accuracy, transfer, transfer_partial, transfer_paper, take_over, drift, bus, dds, drivers, collection, faults,
    stopping, firmware, runtimes, flow, front, motion, stability, untouched, latency, page, endurance, system_faults,
    contacts, fingers,
)  # fmt: skip
BENCHMARKS = {module.BENCHMARK.name: module.BENCHMARK for module in MODULES}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """A subcommand for each benchmark, and for what is known of their results."""
    commands = parser.add_subparsers(dest='benchmark', required=True, metavar='benchmark')
    raw = argparse.RawDescriptionHelpFormatter
    status.add_arguments(
        commands.add_parser('status', help=status.HELP, description=status.__doc__, formatter_class=raw)
    )
    for each in BENCHMARKS.values():
        fill(commands.add_parser(each.name, help=each.help, description=each.about, formatter_class=raw), each)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen one."""
    if arguments.benchmark == 'status':
        return status.run(arguments, list(BENCHMARKS.values()))
    return run_one(BENCHMARKS[arguments.benchmark], arguments)
