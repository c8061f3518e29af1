"""``tactile doctor``: check this machine and suggest how to fix what is missing."""

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

DESCRIPTION = 'Check this machine for force sensing and suggest how to fix what is missing'
EPILOG = """\
The exit status is 1 only if the live view of the simulated sensor cannot run.

examples:
  tactile doctor
  tactile doctor --json | python3 -m json.tool
"""
STYLES = {'ok': 'green', 'warning': 'yellow', 'problem': 'bold red'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--json', action='store_true', help='print the findings as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Run all checks and print them; 1 if there is a problem."""
    findings = [check() for check in CHECKS]
    if arguments.json:
        print(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        show(findings, Console())
    return exit_status(findings)


def exit_status(findings: Sequence[Finding]) -> int:
    """1 if there is a problem that prevents the live view, else 0."""
    return int(any(finding.level == 'problem' for finding in findings))


def show(findings: Sequence[Finding], console: Console) -> None:
    """Print a table of the findings and a one-line summary."""
    table = Table('', 'check', 'found', 'what to do', box=box.SIMPLE_HEAD)
    for finding in findings:
        mark = f'[{STYLES[finding.level]}]{finding.level}[/]'
        table.add_row(mark, finding.name, escape(finding.found), escape(finding.remedy))
    with console.capture() as shown:
        console.print(table)
        console.print(summary(findings))
    console.file.write(shown.get())  # rich would end with status 1 when the reader has gone


def summary(findings: Sequence[Finding]) -> str:
    """A one-sentence summary of all findings."""
    problems = [finding.name for finding in findings if finding.level == 'problem']
    warnings = [finding.name for finding in findings if finding.level == 'warning']
    if problems:
        return f'This machine cannot run the live view yet. Fix first: {", ".join(problems)}.'
    if warnings:
        return f'This machine can run the live view. Warnings: {", ".join(warnings)}.'
    return 'All checks passed.'
