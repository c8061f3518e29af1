"""Processes that the launch needs and that are to be started again: after which end the launch goes on, and when."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tactile_nodes.errors import NOT_AGAIN
from tactile_nodes.launching.processes import supervisor
from tactile_nodes.launching.processes.output import Line
from tactile_nodes.launching.service import LaunchService

KILLED_ONCE = 'test -e {marker} && exec sleep 60; touch {marker}; kill -9 $$'
FAILED_ONCE = 'test -e {marker} && exec sleep 60; touch {marker}; exit 1'
SOON_AGAIN = "respawn: 'true', respawn_delay: 0.01"


def run(folder: Path, actions: str, stop_at: int = 2) -> tuple[int, list[str], list[float]]:
    """Run a launch until so many starts were reported: its status, what it said, and the delays it waited."""
    file = folder / 'test.launch.yaml'
    file.write_text(f'launch:\n{actions}', encoding='utf-8')
    shown: list[str] = []

    def screen(line: Line) -> None:
        shown.append(str(line))
        if sum('process started' in text for text in shown) == stop_at:
            service.shutdown('the test is over')

    service = LaunchService(file, screen=screen, environment=os.environ, log_base=folder / 'logs')
    delays: list[float] = []
    after = service._agenda.after
    service._agenda.after = lambda seconds, task: (delays.append(seconds), after(seconds, task))[1]  # type: ignore[method-assign]
    return service.run(), shown, delays


def action(script: str, folder: Path, options: str = "on_exit: shutdown, respawn: 'true'") -> str:
    program = folder / 'program'
    program.write_text(f'#!/bin/sh\n{script.format(marker=folder / "marker")}\n', encoding='ascii')
    program.chmod(0o755)
    return f'  - executable: {{cmd: {program}, {options}}}\n'


def starts(shown: list[str]) -> int:
    return sum('process started' in text for text in shown)


@pytest.mark.parametrize(
    ('script', 'settled_s', 'status', 'started'),
    [
        pytest.param(KILLED_ONCE, None, 0, 2, id='killed'),
        pytest.param(FAILED_ONCE, None, 1, 1, id='failed soon after its start'),
        pytest.param(FAILED_ONCE, 0.0, 0, 2, id='failed after it had worked'),
        pytest.param('exit 0', 0.0, 0, 1, id='ended cleanly'),
        pytest.param(f'exit {NOT_AGAIN}', 0.0, 1, 1, id='only a person can set it right'),
    ],
)
def test_a_needed_process_is_started_again_or_ends_the_launch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, settled_s: float | None, status: int, started: int
) -> None:
    if settled_s is not None:
        monkeypatch.setattr(supervisor, 'SETTLED_S', settled_s)
    ended, shown, _ = run(tmp_path, action(script, tmp_path))
    assert (ended, starts(shown)) == (status, started)
    assert any('was required' in text for text in shown) is (started == 1)


def test_a_program_that_the_launch_does_not_need_is_started_again_whatever_its_status(tmp_path: Path) -> None:
    """A second DDS bridge ends with this status while the first one runs, and is to take over after it."""
    status, shown, delays = run(tmp_path, action(f'exit {NOT_AGAIN}', tmp_path, SOON_AGAIN), stop_at=5)
    assert (status, starts(shown)) == (0, 5)
    assert delays[:4] == pytest.approx([0.01, 0.02, 0.04, 0.08])


def test_a_process_that_ends_each_time_waits_longer_each_time_without_a_delay_in_the_file_too(tmp_path: Path) -> None:
    _, _, delays = run(tmp_path, action('exit 1', tmp_path, "respawn: 'true'"), stop_at=4)
    assert delays[:3] == pytest.approx([0.0, 0.2, 0.4])


@pytest.mark.parametrize('ends', [40, 1025, 100_000])
@pytest.mark.parametrize('delay_s', [0.0, 0.1])
def test_the_wait_for_a_restart_grows_to_half_a_minute_at_most(delay_s: float, ends: int) -> None:
    """Also over days: 2.0 to the power of 1024 is no float."""
    made = object.__new__(supervisor.Supervisor)
    made.plan = type('Plan', (), {'respawn_delay_s': delay_s})()  # type: ignore[assignment]
    made._quick = ends
    assert made._delay_s == 30.0


def test_processes_of_a_launch_are_reported_where_to_keep_what_they_decide(tmp_path: Path) -> None:
    _, shown, _ = run(tmp_path, action('echo "kept in $TACTILE_KEEP"', tmp_path, 'output: screen'), stop_at=9)
    (line,) = (text for text in shown if 'kept in' in text)
    assert line.endswith('/kept')
    assert Path(line.partition('kept in ')[2]).parent.parent == tmp_path / 'logs'


@pytest.mark.parametrize('needed', ['', ', on_exit: shutdown'])
def test_a_process_whose_program_is_missing_at_a_restart_is_tried_again(tmp_path: Path, needed: str) -> None:
    """An upgrade of the package removes the programs, and writes them again a moment later."""
    action(f'mv {tmp_path}/program {tmp_path}/away; kill -9 $$', tmp_path)
    file = tmp_path / 'test.launch.yaml'
    actions = f'  - executable: {{cmd: {tmp_path}/program, {SOON_AGAIN}{needed}}}\n'
    file.write_text(f'launch:\n{actions}', encoding='utf-8')
    shown: list[str] = []

    def screen(line: Line) -> None:
        shown.append(str(line))
        if 'could not be started' in shown[-1]:
            action('exec sleep 60', tmp_path)
        if starts(shown) == 2:
            service.shutdown('the test is over')

    service = LaunchService(file, screen=screen, environment=os.environ, log_base=tmp_path / 'logs')
    assert (service.run(), starts(shown)) == (0, 2)


def test_a_launch_that_another_launch_starts_keeps_where_that_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sensors of a hand are launched again and again: an object may be held meanwhile, and be no rest image."""
    monkeypatch.setenv('TACTILE_KEEP', str(tmp_path / 'outer'))
    _, shown, _ = run(tmp_path, action('echo "kept in $TACTILE_KEEP"', tmp_path, 'output: screen'), stop_at=9)
    assert any(text.endswith(f'kept in {tmp_path / "outer"}') for text in shown)
