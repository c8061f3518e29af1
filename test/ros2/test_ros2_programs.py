"""Programs that the tests of this folder start leave nothing behind."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from ros2_programs import Program

Until = Callable[[Callable[[], Any]], Any]
# What `ros2 run` does: it goes on waiting for its child when it is interrupted itself.
_LIKE_ROS2_RUN = """
import subprocess, sys
child = subprocess.Popen([sys.executable, '-c', {child!r}])
while child.returncode is None:
    try:
        child.wait()
    except KeyboardInterrupt:
        pass
"""
_SAYS_ITS_NUMBER = 'import os, signal; {first}; print(os.getpid(), flush=True); signal.pause()'
_DEAF = 'signal.signal(signal.SIGINT, signal.SIG_IGN)'


def _is_there(number: int) -> bool:
    """Running, that is: who has ended and was not asked for yet counts as gone."""
    try:
        return Path(f'/proc/{number}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


@pytest.mark.parametrize('first', ['pass', _DEAF], ids=['listens', 'deaf'])
def test_a_child_of_a_program_ends_with_it_even_one_that_ignores_sigint(
    first: str, tmp_path: Path, until: Until
) -> None:
    said = tmp_path / 'said.txt'
    code = _LIKE_ROS2_RUN.format(child=_SAYS_ITS_NUMBER.format(first=first))
    program = Program([sys.executable, '-c', code], said)
    child = int(until(said.read_text))
    program.end(within_s=60.0 if first == 'pass' else 0.2)
    until(lambda: not _is_there(child))


def test_a_child_that_outlives_its_program_is_ended_too(tmp_path: Path, until: Until) -> None:
    said = tmp_path / 'said.txt'
    code = f'import subprocess, sys; subprocess.Popen([sys.executable, "-c", {_SAYS_ITS_NUMBER.format(first=_DEAF)!r}])'
    program = Program([sys.executable, '-c', code], said)
    child = int(until(said.read_text))
    program.process.wait(60.0)
    assert os.getpgid(child) == program.process.pid
    program.end(signal.SIGINT)
    until(lambda: not _is_there(child))
