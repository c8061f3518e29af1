"""Check 8: without ROS 2 nothing of ROS 2 is imported.

Expected: rclpy and generated messages are imported in `bus/ros2/` only, and what is there by `bus/node/runtime.py`
only, inside the function that is called when that bus is chosen; with the ZeroMQ bus a node's process has no rclpy in
it.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from ros2_here import ROOT, environment

SOURCES = sorted((ROOT / 'tactile_nodes').rglob('*.py'))
FOREIGN = {'rclpy', 'rosidl_runtime_py', 'rosidl_adapter', 'ament_index_python', 'launch_ros', 'rosbag2_py'}


def _imported(tree: ast.AST) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return found


def _offence(file: Path) -> set[str]:
    text = file.read_text(encoding='utf-8')
    if not any(word in text for word in ('ros2', 'tactile_nodes.msg', *FOREIGN)):  # saves most of the reading
        return set()
    names = _imported(ast.parse(text))
    ours = {'tactile_nodes.msg'} | ({'tactile_nodes.bus.ros2.graph_bus'} if file.name != 'runtime.py' else set())
    return {name for name in names if name.split('.')[0] in FOREIGN or any(name.startswith(one) for one in ours)}


def test_modules_import_nothing_of_ros_2() -> None:
    others = [file for file in SOURCES if file.parent != ROOT / 'tactile_nodes/bus/ros2']
    assert {str(file): found for file in others if (found := _offence(file))} == {}


def test_ros_2_bus_is_imported_only_when_it_is_chosen() -> None:
    tree = ast.parse((ROOT / 'tactile_nodes/bus/node/runtime.py').read_text(encoding='utf-8'))
    at_import = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    assert not any('ros2' in name for node in at_import for name in _imported(ast.Module([node], [])))
    assert any('bus.ros2' in name for name in _imported(tree))


def test_process_on_the_zeromq_bus_has_no_rclpy_in_it() -> None:
    code = (
        'import sys; from tactile_nodes.bus.node.runtime import open_bus; import tactile_nodes.nodes.composed; '
        'open_bus().close(); sys.exit("rclpy" in sys.modules)'
    )
    env = environment(TACTILE_BUS='zeromq')
    assert subprocess.run([sys.executable, '-c', code], env=env, check=False).returncode == 0
