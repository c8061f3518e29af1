"""Whether this machine has ROS 2, and what the tests of this folder do with it."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EMULATOR = Path(__file__).parent / 'rclpy_emulator'
HAS_ROS = importlib.util.find_spec('rclpy') is not None
DOMAIN_ID = os.environ.get('ROS_DOMAIN_ID', '74')

needs_ros = pytest.mark.skipif(not HAS_ROS, reason='needs ROS 2: source its setup.bash, see docs/ros2.md')


def environment(**more: str) -> dict[str, str]:
    """The environment of a program that is started from these tests; its rclpy is the emulator where ROS 2 is not."""
    before = [path for path in [os.environ.get('PYTHONPATH')] if path]
    paths = before if HAS_ROS else [str(ROOT), str(EMULATOR), *before]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths), 'ROS_DOMAIN_ID': DOMAIN_ID, **more}


def run(words: list[str], env: dict[str, str], timeout_s: float = 60.0, cwd: Path | None = None) -> str:
    """What a program says on its standard output; the test fails with all it said when it fails.

    It runs where no source tree lies, so that what is installed is imported.
    """
    assert shutil.which(words[0], path=env.get('PATH')), f'there is no program {words[0]}'
    ended = subprocess.run(
        words, env=env, cwd=cwd or tempfile.gettempdir(), capture_output=True, text=True, timeout=timeout_s,
        check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert ended.returncode == 0, f'{" ".join(words)}\n{ended.stdout}\n{ended.stderr}'
    return ended.stdout
