"""Where ROS 2 was sourced, what colcon installed goes before the source tree: only that has the message classes.

pytest puts the tree first (`pythonpath` in pyproject.toml). To be imported before anything of the package is.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

if importlib.util.find_spec('rclpy') is not None:
    _tree = str(Path(__file__).parents[1])
    sys.path[:] = [*(path for path in sys.path if path != _tree), _tree]
