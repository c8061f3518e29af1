"""A workspace in which this package is built with colcon, and programs run as if its setup.bash was sourced."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from ros2_here import DOMAIN_ID, ROOT, run

PACKAGE = 'tactile_nodes'


def build(workspace: Path) -> dict[str, str]:
    """Build into `workspace`; the environment that sourcing its setup.bash gives.

    `TACTILE_ROS_INSTALL` names an install folder that is there already, and saves the build.
    """
    if not (installed := os.environ.get('TACTILE_ROS_INSTALL')):
        words = ['colcon', '--log-base', str(workspace / 'log'), 'build', '--base-paths', str(ROOT)]
        words += ['--build-base', str(workspace / 'build'), '--install-base', str(workspace / 'install')]
        run([*words, '--packages-select', PACKAGE], dict(os.environ), timeout_s=600.0, cwd=workspace)
        installed = str(workspace / 'install')
    return sourced(Path(installed) / 'setup.bash')


def sourced(script: Path) -> dict[str, str]:
    """The environment after ``source script``, without a source tree in the way."""
    said = subprocess.run(
        ['bash', '-c', 'source "$0" && env -0', str(script)], capture_output=True, text=True, check=True
    ).stdout
    found = dict(entry.split('=', 1) for entry in said.split('\0') if '=' in entry)
    found.pop('TACTILE_BUS', None)
    return {**found, 'ROS_DOMAIN_ID': DOMAIN_ID, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
