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
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

sys.dont_write_bytecode = False
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

if importlib.util.find_spec('rclpy') is not None:
    sys.path[:] = [*(path for path in sys.path if path != str(ROOT)), str(ROOT)]


def compile_share(config: pytest.Config, checked: list[str]) -> None:
    """Have each worker compile its share of the sources: in a fresh checkout each would compile all of them.

    Files of tests get pytest's assertions, and those of the packages that are `checked` the checks of their arrays.
    """
    worker = getattr(config, 'workerinput', None)
    if worker is None:
        return
    files = sorted(file for room in ('tactile_nodes', 'benchmarks', 'test') for file in (ROOT / room).rglob('*.py'))
    for file in files[int(worker['workerid'].removeprefix('gw')) :: worker['workercount']]:
        name = '.'.join(file.relative_to(ROOT).with_suffix('').parts)
        if file.name.startswith('test_') or file.name == 'conftest.py':
            loader = next(finder for finder in sys.meta_path if hasattr(finder, 'mark_rewrite'))
            load_without_imports(importlib.util.spec_from_file_location(name, file, loader=loader))
        elif name.startswith(tuple(f'{package}.' for package in checked)):
            load_without_imports(importlib.util.find_spec(name))
        else:
            compileall.compile_file(file, quiet=2)


def load_without_imports(spec: ModuleSpec) -> None:
    """Have the loader of a module keep its bytecode; the module itself ends at its first import."""
    module = importlib.util.module_from_spec(spec)
    module.__builtins__ = {}
    with contextlib.suppress(ImportError, NameError, SyntaxError):  # a fault is reported where it is really imported
        spec.loader.exec_module(module)
