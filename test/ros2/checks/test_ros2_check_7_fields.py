"""Check 7: nothing is assigned to a field of rclpy's messages that does not belong there.

Expected: the tests of the bus and of nodes on it pass with ROS_PYTHON_CHECK_FIELDS=1, which has rclpy check each
assignment. (It is read when a generated class is imported, hence the process of its own.)
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from ros2_here import needs_ros, run

TESTS = Path(__file__).parents[1]
CHECKED = ['test_ros2_bus.py', 'test_ros2_nodes.py']


def _inner(name: str, environment: Mapping[str, str], *more: str) -> str:
    """What a pytest of its own says of a file of the folder above, whatever the outer one was given."""
    said_to_the_outer = ('PYTEST_ADDOPTS', 'PYTEST_PLUGINS', 'PYTEST_XDIST_')
    env = {key: value for key, value in environment.items() if not key.startswith(said_to_the_outer)}
    env |= {'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'ROS_PYTHON_CHECK_FIELDS': '1'}
    words = [sys.executable, '-m', 'pytest', '-p', 'pytest_timeout', '-q', *more, str(TESTS / name)]
    return run(words, env, timeout_s=500.0, cwd=TESTS)


@needs_ros
@pytest.mark.timeout(600)
@pytest.mark.parametrize('name', CHECKED)
def test_tests_of_the_bus_pass_with_checked_fields(name: str) -> None:
    _inner(name, os.environ)


def test_options_of_the_outer_pytest_are_not_those_of_the_inner_one() -> None:
    """The half of the check that needs no ROS 2: docs/ros2.md has the plugins named on the command line."""
    outer = {'PYTEST_ADDOPTS': '-n 0', 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'PYTEST_XDIST_WORKER': 'gw0'}
    assert '::test_' in _inner(CHECKED[0], {**os.environ, **outer}, '--collect-only')
