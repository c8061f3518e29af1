"""What is settled before anything else is imported: where Python keeps bytecode, and which of our packages is taken.

Without bytecode each worker, and each of the hundreds of processes that tests start, would compile anew all that it
imports, and pytest the assertions in Hypothesis. Whoever wants none beside the sources has it apart from them.

Where ROS 2 was sourced, what colcon installed goes before the source tree: only that has the message classes. pytest
puts the tree first (`pythonpath` in pyproject.toml).
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(ROOT / '.pytest_cache' / 'bytecode')
    os.environ['PYTHONPYCACHEPREFIX'] = sys.pycache_prefix
    os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

if importlib.util.find_spec('rclpy') is not None:
    sys.path[:] = [*(path for path in sys.path if path != str(ROOT)), str(ROOT)]
