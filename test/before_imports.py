"""What is settled before anything else is imported: that Python keeps bytecode, and which of our packages is taken.

Without it each worker, and each of the hundreds of processes that tests start, would compile anew all that it imports,
and pytest the assertions in Hypothesis. It is kept beside the sources even where the environment forbids that: in a
folder of its own, what pip has compiled of torch and others would be compiled once more in each worker.

Where ROS 2 was sourced, what colcon installed goes before the source tree: only that has the message classes. pytest
puts the tree first (`pythonpath` in pyproject.toml).
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

if importlib.util.find_spec('rclpy') is not None:
    sys.path[:] = [*(path for path in sys.path if path != str(ROOT)), str(ROOT)]
