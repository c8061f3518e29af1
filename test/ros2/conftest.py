"""ROS 2 where it is installed, and an emulator of rclpy where it is not."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from ros2_here import DOMAIN_ID, EMULATOR, HAS_ROS
from ros2_programs import Program
from ros2_workspace import build

DEADLINE_S = 30.0

Until = Callable[[Callable[[], Any]], Any]


@pytest.fixture
def until() -> Until:
    """What a condition returns once that is true; the test fails when it does not come true in time."""

    def wait(condition: Callable[[], Any]) -> Any:
        deadline_s = time.monotonic() + DEADLINE_S
        while not (found := condition()):
            assert time.monotonic() < deadline_s, 'waited too long'
            time.sleep(0.005)
        return found

    return wait


@pytest.fixture(scope='module')
def emulated() -> Iterator[None]:
    """rclpy can be imported: the real one, or the emulator for the time of these tests."""
    if HAS_ROS:
        yield
        return
    sys.path.insert(0, str(EMULATOR))
    yield
    sys.path.remove(str(EMULATOR))
    if generated := sys.modules.get('rclpy.generated'):
        generated.remove()
    package = importlib.import_module('tactile_nodes.bus')
    for name in list(sys.modules):
        if name.split('.')[0] == 'rclpy' or f'{name}.'.startswith(f'{package.__name__}.ros2.'):
            del sys.modules[name]
    vars(package).pop('ros2', None)


@pytest.fixture(scope='session', autouse=True)
def _no_short_cut_within_a_process() -> None:
    """Fast DDS, the default of Jazzy, reads this when the first of its participants is made."""
    os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(Path(__file__).with_name('fast_dds.xml')))


@pytest.fixture
def join(emulated: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Any]]:
    """Join the ROS 2 graph of the test from this process; several times makes several participants."""
    ros2 = importlib.import_module('tactile_nodes.bus.ros2.graph_bus')
    if not HAS_ROS:  # what the emulator knows, it knows at once
        monkeypatch.setattr(ros2, 'LONGEST_S', 0.0)
        monkeypatch.setattr(ros2, '_LOOK_AGAIN_S', 0.0)
    monkeypatch.setenv('ROS_DOMAIN_ID', DOMAIN_ID)
    buses: list[Any] = []

    def make() -> Any:
        buses.append(ros2.Ros2Bus())
        return buses[-1]

    yield make
    for bus in buses:
        bus.close()


@pytest.fixture(scope='session')
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment in which the package was built with colcon and sourced."""
    environment = build(tmp_path_factory.mktemp('ws'))
    yield environment
    subprocess.run(['ros2', 'daemon', 'stop'], env=environment, check=False)  # which the tools started


@pytest.fixture
def running(installed: dict[str, str], tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a program beside the test, in the sourced environment; SIGINT ends it and its children, as Ctrl-C would."""
    started: list[Program] = []

    def start(*words: str, **more: str) -> subprocess.Popen[str]:
        said = tmp_path / f'said-{len(started)}.txt'
        started.append(Program(words, said, env={**installed, **more}, cwd=tmp_path))
        return started[-1].process

    yield start
    for program in started:
        program.send(signal.SIGINT)
    for program in started:
        program.end()
