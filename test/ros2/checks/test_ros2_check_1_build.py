"""Check 1: colcon builds the package, and ROS 2 finds its programs and messages.

Expected: `colcon build` ends with status 0 (about 20 s); `ros2 pkg executables` names a program for each node and
`tactile`; `ros2 interface show` prints each file of msg/, its fields and constants.
"""

from __future__ import annotations

import re

import pytest
from ros2_here import ROOT, needs_ros, run

pytestmark = [needs_ros, pytest.mark.timeout(900)]

MESSAGES = sorted(file.stem for file in (ROOT / 'msg').glob('*.msg'))


def test_every_node_is_an_executable(installed: dict[str, str]) -> None:
    said = run(['ros2', 'pkg', 'executables', 'tactile_nodes'], installed)
    nodes = re.search(r'NODES = \[(.*?)\]', (ROOT / 'setup.py').read_text(encoding='utf-8'), re.DOTALL)
    assert nodes is not None
    expected = {f'{name}_node' for name in re.findall(r"'(\w+)'", nodes.group(1))} | {'tactile'}
    assert {line.split()[1] for line in said.splitlines() if line.strip()} == expected


def test_package_is_found(installed: dict[str, str]) -> None:
    prefix = run(['ros2', 'pkg', 'prefix', 'tactile_nodes'], installed).strip()
    assert (ROOT.__class__(prefix) / 'share/tactile_nodes/launch/live.launch.yaml').is_file()


@pytest.mark.parametrize('name', MESSAGES)
def test_definition_of_a_message_is_shown(installed: dict[str, str], name: str) -> None:
    said = run(['ros2', 'interface', 'show', f'tactile_nodes/msg/{name}'], installed)
    text = (ROOT / f'msg/{name}.msg').read_text(encoding='utf-8')
    wanted = [line.split('#')[0].split() for line in text.splitlines() if line.split('#')[0].strip()]
    shown = [line.split('#')[0].split() for line in said.splitlines()]
    assert [words for words in wanted if words not in shown] == []


def test_generated_classes_and_our_modules_are_one_package(installed: dict[str, str]) -> None:
    code = 'import tactile_nodes.msg as m, tactile_nodes.bus.ros2.graph_bus; print(m.ForceDistribution().total)'
    assert run(['python3', '-c', code], installed).strip() == '0.0'
