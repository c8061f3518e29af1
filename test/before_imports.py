"""What is settled before anything else is imported: that Python keeps bytecode, and which of our packages is taken.

Without it each worker, and each of the hundreds of processes that tests start, would compile anew all that it imports,
and pytest the assertions in Hypothesis. It is kept beside the sources even where the environment forbids that: in a
folder of its own, what pip has compiled of torch and others would be compiled once more, 20 s in each worker.

Where ROS 2 was sourced, what colcon installed goes before the source tree: only that has the message classes. pytest
puts the tree first (`pythonpath` in pyproject.toml).
"""

from __future__ import annotations

import compileall
import contextlib
import importlib.util
import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

if importlib.util.find_spec('rclpy') is not None:
    sys.path[:] = [*(path for path in sys.path if path != str(ROOT)), str(ROOT)]


def compile_share(config: pytest.Config) -> None:
    """Have each worker compile its share of the sources: in a fresh checkout each would compile all of them."""
    worker = getattr(config, 'workerinput', None)
    if worker is None:
        return
    files = sorted(file for room in ('tactile_nodes', 'benchmarks', 'test') for file in (ROOT / room).rglob('*.py'))
    for file in files[int(worker['workerid'].removeprefix('gw')) :: worker['workercount']]:
        if file.name.startswith('test_') or file.name == 'conftest.py':
            rewrite_asserts(file)
        else:
            compileall.compile_file(file, quiet=2)


def rewrite_asserts(file: Path) -> None:
    """Have pytest keep the bytecode of a file of tests, without what the file imports: at its first import it ends."""
    loader = next(finder for finder in sys.meta_path if hasattr(finder, 'mark_rewrite'))
    spec = importlib.util.spec_from_file_location(file.stem, file, loader=loader)
    module = importlib.util.module_from_spec(spec)
    module.__builtins__ = {}
    with contextlib.suppress(ImportError):
        loader.exec_module(module)
