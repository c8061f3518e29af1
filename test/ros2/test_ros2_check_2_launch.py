"""Check 2: every launch file is ROS 2's, and our launcher starts the same programs with the same words.

Expected: `ros2 launch FILE --show-args` and `--print` end with status 0; run with stubs in place of the nodes, `ros2
launch` and `tactile launch` hand each program the same argv and the same content of parameter files, in the same order.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from launch_stub import LAUNCHES, make_prefix, started_by
from ros2_here import ROOT, needs_ros, run

pytestmark = pytest.mark.timeout(300)
_OURS = [sys.executable, '-m', 'tactile_nodes', 'launch', '-n']


def _environment() -> dict[str, str]:
    return {**os.environ, 'PYTHONPATH': os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')]).rstrip(':')}


def _name(file: Path) -> str:
    return file.name


@needs_ros
@pytest.mark.parametrize('flag', ['--show-args', '--print'])
@pytest.mark.parametrize('file', LAUNCHES, ids=_name)
def test_launch_file_is_read_by_ros_2(file: Path, flag: str, tmp_path: Path) -> None:
    prefix = make_prefix(tmp_path / 'prefix')
    before = os.environ.get('AMENT_PREFIX_PATH', '')
    run(['ros2', 'launch', str(file), flag], {**os.environ, 'AMENT_PREFIX_PATH': f'{prefix}:{before}'.rstrip(':')})


@needs_ros
@pytest.mark.parametrize('file', LAUNCHES, ids=_name)
def test_both_launchers_start_the_same_programs_with_the_same_words(file: Path, tmp_path: Path) -> None:
    prefix = make_prefix(tmp_path / 'prefix')
    ours = started_by([*_OURS, str(file)], prefix, tmp_path / 'ours', _environment())
    theirs = started_by(['ros2', 'launch', '-n', str(file)], prefix, tmp_path / 'theirs', dict(os.environ))
    assert ours == theirs


def test_stubs_note_how_our_launcher_starts_them(tmp_path: Path) -> None:
    """The half of the check that needs no ROS 2."""
    prefix = make_prefix(tmp_path / 'prefix')
    file = ROOT / 'launch/live.launch.yaml'
    noted = started_by([*_OURS, str(file)], prefix, tmp_path / 'ours', _environment())
    assert len(noted) >= 3
    sensing = next(entry for entry in noted if '__node:=camera' in entry['words'] or 'camera' in entry['name'])
    assert sensing['words'].count('--ros-args') >= 1
    assert str(ROOT / 'config/live.yaml') in sensing['words']
    assert all(isinstance(content, dict) for entry in noted for content in entry['files'])
