"""What the tests of the launcher share: launch files written into a folder, and a host that notes what they ask for."""

from __future__ import annotations

import sys
import textwrap
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tactile_nodes.launching.context import Context
from tactile_nodes.launching.interpreter import Interpreter
from tactile_nodes.launching.processes.output import Line
from tactile_nodes.launching.service import LaunchService


@dataclass
class Notes:
    """A host that starts nothing."""

    lines: list[Line] = field(default_factory=list)
    plans: list = field(default_factory=list)
    timers: list = field(default_factory=list)
    shutdowns: list[str] = field(default_factory=list)

    def log(self, level, source, text):
        self.lines.append(Line(source, text, level=level))

    def start(self, plan):
        self.plans.append(plan)

    def after(self, seconds, actions, file, cancel_on_shutdown):
        self.timers.append((seconds, actions, file, cancel_on_shutdown))

    def request_shutdown(self, reason):
        self.shutdowns.append(reason)

    @property
    def texts(self):
        return [line.text for line in self.lines]

    @property
    def commands(self):
        return [list(plan.command) for plan in self.plans]


@pytest.fixture
def launch_file(tmp_path):
    """Writes a launch file whose actions are given as YAML."""

    def write(actions: str, name: str = 'test.launch.yaml') -> Path:
        file = tmp_path / name
        file.write_text('launch:\n' + textwrap.indent(textwrap.dedent(actions), '  '), encoding='utf-8')
        return file

    return write


@pytest.fixture
def interpret(tmp_path, launch_file):
    """Runs the actions of a launch file without starting anything; returns what was asked for."""

    def run(actions: str, environment: dict | None = None, **arguments: str) -> Notes:
        notes = Notes()
        file = launch_file(actions)
        (tmp_path / 'log').mkdir(exist_ok=True)
        context = Context(environment or {}, tmp_path / 'log', file=file)
        notes.interpreter = Interpreter(context, notes)
        notes.interpreter.include(file, arguments)
        return notes

    return run


@pytest.fixture
def launch(tmp_path, launch_file):
    """Runs actions to their end; `when` maps a text on the screen to what is then done with the service."""

    def run(actions, when=None, *, environment=None, arguments=None, **options):
        shown = []

        def screen(line):
            shown.append(str(line))
            for text, react in (when or {}).items():
                if text in str(line):
                    react(service)

        service = LaunchService(
            launch_file(actions),
            arguments,
            screen=screen,
            environment={'PATH': '/usr/bin:/bin', **(environment or {})},
            log_base=tmp_path / 'logs',
            **options,
        )
        status = service.run()
        return status, shown, service

    return run


@pytest.fixture
def program(tmp_path):
    """Writes an executable Python program."""

    def write(code: str, name: str = 'program') -> Path:
        file = tmp_path / name
        file.write_text(f'#!{sys.executable} -S\n{textwrap.dedent(code)}', encoding='utf-8')
        file.chmod(0o755)
        return file

    return write


@pytest.fixture
def prefix(tmp_path):
    """An ament prefix with the package `demo`: one executable, one launch file."""
    folder = tmp_path / 'prefix'
    for inner in ('share/ament_index/resource_index/packages', 'share/demo/launch', 'lib/demo'):
        (folder / inner).mkdir(parents=True)
    (folder / 'share/ament_index/resource_index/packages/demo').touch()
    (folder / 'share/demo/launch/demo.launch.yaml').write_text('launch: []\n')
    (folder / 'lib/demo/talker').write_text('#!/bin/sh\n')
    (folder / 'lib/demo/talker').chmod(0o755)
    return folder
