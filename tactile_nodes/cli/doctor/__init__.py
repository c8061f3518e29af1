"""``tactile doctor``: what this machine lacks, and what to do about it."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tactile_nodes.cli.doctor.checks import CHECKS, Finding

DESCRIPTION = 'Say what this machine lacks for force sensing, and what to do about it'
EPILOG = """\
The exit status is 1 only if something keeps the live view of the simulated sensor from running.

examples:
  tactile doctor
  tactile doctor --json | python3 -m json.tool
"""
STYLES = {'ok': 'green', 'warning': 'yellow', 'problem': 'bold red'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('--json', action='store_true', help='print the findings as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Look at everything and say it; 1 if there is a problem."""
    findings = [check() for check in CHECKS]
    if arguments.json:
        print(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        show(findings, Console())
    return exit_status(findings)


def exit_status(findings: Sequence[Finding]) -> int:
    """1 if something prevents the main job, else 0."""
    return int(any(finding.level == 'problem' for finding in findings))


def show(findings: Sequence[Finding], console: Console) -> None:
    """A table of what was found, and one line that sums it up."""
    table = Table('', 'check', 'found', 'what to do', box=box.SIMPLE_HEAD)
    for finding in findings:
        mark = f'[{STYLES[finding.level]}]{finding.level}[/]'
        table.add_row(mark, finding.name, escape(finding.found), escape(finding.remedy))
    console.print(table)
    console.print(summary(findings))


def summary(findings: Sequence[Finding]) -> str:
    """One sentence on all findings."""
    problems = [finding.name for finding in findings if finding.level == 'problem']
    warnings = [finding.name for finding in findings if finding.level == 'warning']
    if problems:
        return f'This machine cannot run the live view yet; mend first: {", ".join(problems)}.'
    if warnings:
        return f'This machine can run the live view; worth a look: {", ".join(warnings)}.'
    return 'This machine lacks nothing.'
