"""Check 3: rcl's reader of parameter files and ours make the same values of every file that ships.

Expected: an rclpy node of each name that a file speaks of, started with `--params-file`, has the values, with their
types, that `tactile_nodes.params` gives a node of that name; and what `ros2 param dump` prints of a running node is
what its file says.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from ros2_here import DOMAIN_ID, ROOT, needs_ros, run

from tactile_nodes import params

pytestmark = pytest.mark.timeout(900)
FILES = sorted(file for file in (ROOT / 'config').rglob('*.yaml') if 'ros__parameters' in file.read_text('utf-8'))
NAMES = sorted(file.stem for file in (ROOT / 'tactile_nodes/nodes').glob('[a-z]*.py') if file.stem != 'composed')


def _id(file: Path) -> str:
    return str(file.relative_to(ROOT / 'config'))


@needs_ros
@pytest.mark.parametrize('file', FILES, ids=_id)
def test_rcl_and_our_reader_agree(file: Path) -> None:
    import rclpy

    blocks = params.load_parameter_file(str(file))
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(DOMAIN_ID))
    try:
        for namespace in ('/', '/skin/left'):
            for name in NAMES:
                ours = params.resolve_parameters(f'{namespace.rstrip("/")}/{name}', blocks)
                theirs = _rcl_values(context, name, namespace, file)
                assert {key: _typed(entry.value) for key, entry in ours.items()} == theirs, name
    finally:
        context.try_shutdown()


def _rcl_values(context: Any, name: str, namespace: str, file: Path) -> dict[str, Any]:
    from rclpy.node import Node

    node = Node(
        name,
        namespace=namespace,
        context=context,
        cli_args=['--ros-args', '--params-file', str(file)],
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        allow_undeclared_parameters=True,
        automatically_declare_parameters_from_overrides=True,
    )
    found = {key: _typed(_listed(entry.value)) for key, entry in node.get_parameters_by_prefix('').items()}
    node.destroy_node()
    for own in ('use_sim_time', 'start_type_description_service'):  # rclpy's own
        found.pop(own, None)
    return found


def _listed(value: Any) -> Any:
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, (str, bytes)) else value


def _typed(value: Any) -> Any:
    """A value that differs from another when only their types do: 1 from 1.0, false from 0."""
    return [_typed(item) for item in value] if isinstance(value, list) else (type(value).__name__, value)


@needs_ros
def test_dump_of_a_running_node_is_what_its_file_says(
    installed: dict[str, str], running: Callable[..., Any], until: Callable[..., Any], tmp_path: Path
) -> None:
    file = tmp_path / 'p.yaml'
    file.write_text('/**/flow_features:\n  ros__parameters:\n    reference: topic\n    use_sim_time: true\n')
    node = '/skin/flow_features'
    arguments = ['--ros-args', '-r', '__ns:=/skin', '--params-file', str(file)]
    running('ros2', 'run', 'tactile_nodes', 'flow_features_node', *arguments)
    until(lambda: node in run(['ros2', 'node', 'list'], installed))
    dumped = yaml.safe_load(run(['ros2', 'param', 'dump', node], installed))[node]['ros__parameters']
    assert dumped['reference'] == 'topic'
    assert dumped['use_sim_time'] is True
    assert _flat(dumped) == _defaults() | {'reference': 'topic', 'use_sim_time': True}


def _flat(values: dict[str, Any], prefix: str = '') -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= _flat(value, f'{prefix}{name}.') if isinstance(value, dict) else {prefix + name: value}
    return found


def _defaults() -> dict[str, Any]:
    from tactile_nodes.nodes.flow_features import FlowFeaturesNode

    return params.to_values(FlowFeaturesNode.PARAMS())


def test_files_that_ship_speak_of_nodes_that_exist() -> None:
    """So that check 3 compares something."""
    assert FILES
    for file in FILES:
        blocks = params.load_parameter_file(str(file))
        assert any(params.resolve_parameters(f'/{name}', blocks) for name in NAMES), file
    assert sys.version_info >= (3, 10)
