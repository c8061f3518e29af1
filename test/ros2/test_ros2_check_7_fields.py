"""Check 7: nothing is assigned to a field of rclpy's messages that does not belong there.

Expected: the tests of the bus and of nodes on it pass with ROS_PYTHON_CHECK_FIELDS=1, which has rclpy check each
assignment. (It is read when a generated class is imported, hence the process of its own.)
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from ros2_here import needs_ros, run


@needs_ros
@pytest.mark.timeout(600)
@pytest.mark.parametrize('name', ['test_ros2_bus.py', 'test_ros2_nodes.py'])
def test_tests_of_the_bus_pass_with_checked_fields(name: str) -> None:
    words = [sys.executable, '-m', 'pytest', '-q', str(Path(__file__).with_name(name))]
    run(words, {**os.environ, 'ROS_PYTHON_CHECK_FIELDS': '1'}, timeout_s=500.0, cwd=Path(__file__).parent)
