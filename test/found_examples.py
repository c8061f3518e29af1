"""What `make fuzz` finds is kept: Hypothesis tries it first in the next round, and a person makes a test of it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Generator
from pathlib import Path

import hypothesis
import pytest
from hypothesis.database import DirectoryBasedExampleDatabase, ExampleDatabase

NAMED = 100
"""Characters of a test's name that its file is called by."""


class FoundExamples:
    """A plugin of pytest: one text file for each random test that fails, and where it is at the end of the report."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._folder, self._seed = folder, seed

    @property
    def database(self) -> ExampleDatabase:
        """Of Hypothesis: failing examples, which it tries before any other."""
        return DirectoryBasedExampleDatabase(self._folder / 'examples')

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Every random test draws from the seed.

        With --hypothesis-seed or `hypothesis.seed` it would neither keep examples nor look at those that were found.
        """
        for item in items:
            if isinstance(item, pytest.Function) and hypothesis.is_hypothesis_test(item.obj):
                item.obj._hypothesis_internal_use_seed = self._seed

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Keep what a random test failed with: its example, and the line that has it tried again."""
        report = yield
        if is_found(report):
            file = self._file(report.nodeid)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f'{report.nodeid}\nmake fuzz SEED={self._seed}\n\n{report.longreprtext}\n', 'utf-8')
        return report

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Say where each of them is, and what to do with it."""
        found = [self._file(each.nodeid) for each in terminalreporter.stats.get('failed', ()) if is_found(each)]
        if kept := [file for file in found if file.exists()]:
            terminalreporter.section('found by other examples; make each a test, by @example or of its own')
        for file in kept:
            terminalreporter.line(str(file))

    def _file(self, test: str) -> Path:
        digest = hashlib.sha256(test.encode()).hexdigest()[:6]
        return self._folder / f'{re.sub(r"[^A-Za-z0-9_]+", "-", test)[-NAMED:]}-{digest}-{self._seed}.txt'


def is_found(report: pytest.TestReport) -> bool:
    """Whether a random test failed on an example."""
    return report.when == 'call' and report.failed and 'hypothesis' in report.keywords
