"""Check 2: every launch file is ROS 2's, and our launcher starts the same programs with the same words.

Expected: `ros2 launch FILE --show-args` and `--print` end with status 0; run with stubs in place of the nodes, `ros2
launch` and `tactile launch` hand each program the same argv and the same content of parameter files, in the same order.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from launch_stub import LAUNCHES, make_prefix, plain, required_arguments, started_by
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
    words = [str(file), *required_arguments(file)]
    ours = started_by([*_OURS, *words], prefix, tmp_path / 'ours', _environment())
    theirs = started_by(['ros2', 'launch', '-n', *words], prefix, tmp_path / 'theirs', dict(os.environ))
    assert ours == theirs


def test_each_program_of_a_launch_file_has_a_stub(tmp_path: Path) -> None:
    stubs = {program.name for program in (make_prefix(tmp_path / 'prefix') / 'lib/tactile_nodes').iterdir()}
    named = {name for file in LAUNCHES for name in re.findall(r'exec: (\w+)', file.read_text(encoding='utf-8'))}
    assert named and named <= stubs


def test_stubs_note_how_our_launcher_starts_them(tmp_path: Path) -> None:
    """The half of the check that needs no ROS 2."""
    prefix = make_prefix(tmp_path / 'prefix')
    file = ROOT / 'launch/live.launch.yaml'
    noted = started_by([*_OURS, str(file)], prefix, tmp_path / 'ours', _environment(), count=5)
    assert len(noted) == 5
    sensing = next(entry for entry in noted if '__node:=camera' in entry['words'] or 'camera' in entry['name'])
    assert sensing['words'].count('--ros-args') >= 1
    assert str(ROOT / 'config/live.yaml') in sensing['words']
    assert all(isinstance(content, dict) for entry in noted for content in entry['files'])


def test_stubs_are_started_also_by_a_file_with_an_argument_that_has_no_default(tmp_path: Path) -> None:
    prefix = make_prefix(tmp_path / 'prefix')
    file = ROOT / 'launch/replay.launch.yaml'
    assert required_arguments(file) == ['bag:=given']
    words = [*_OURS, str(file), *required_arguments(file)]
    noted = started_by(words, prefix, tmp_path / 'ours', _environment(), count=3)
    assert {entry['name'] for entry in noted} == {'composed_node', 'recorder_node', 'player_node'}


def test_a_path_below_the_prefix_is_the_same_in_words_and_in_parameter_files(tmp_path: Path) -> None:
    """The launchers resolve `$(find-pkg-share …)` to different folders, and write what is inline into a file."""
    path = f'{tmp_path}/share/tactile_nodes/config/plans/even.yaml'
    noted = {'name': 'rig_node', 'words': [path], 'files': [f'/**: {{ros__parameters: {{plan: {path}}}}}']}
    here = str(ROOT / 'config/plans/even.yaml')
    assert plain(noted, tmp_path) == {
        'name': 'rig_node',
        'words': [here],
        'files': [{'/**': {'ros__parameters': {'plan': here}}}],
    }
