"""A bridge between two machines on a cable: two network namespaces and a pair of virtual Ethernet devices."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from agents import Other, until

from tactile_nodes.bus.bridge.keys import create_keys

ROBOT, LAB = '10.213.7.1', '10.213.7.2'


def _ip(*words: str) -> None:
    subprocess.run(['ip', *words], check=True, capture_output=True)


@pytest.fixture
def cable() -> Iterator[tuple[str, str]]:
    """The names of two network namespaces, connected by one cable."""
    names = (f'tn{os.getpid()}a', f'tn{os.getpid()}b')
    try:
        for name in names:
            _ip('netns', 'add', name)
        _ip('link', 'add', names[0], 'type', 'veth', 'peer', 'name', names[1])
        for name, address in zip(names, (ROBOT, LAB), strict=True):
            _ip('link', 'set', name, 'netns', name)
            _ip('-n', name, 'address', 'add', f'{address}/24', 'dev', name)
            _ip('-n', name, 'link', 'set', name, 'up')
        yield names
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('network namespaces are not permitted here')
    finally:
        for name in names:
            subprocess.run(['ip', 'netns', 'delete', name], check=False, capture_output=True)


class Machine:
    """A folder of sockets and a bridge in a network namespace."""

    def __init__(self, namespace: str, folder: Path, keys: Path, *parameters: str) -> None:
        folder.mkdir(mode=0o700)
        self.folder = folder
        words = [word for parameter in parameters for word in ('-p', parameter)]
        program = [sys.executable, '-m', 'tactile_nodes.nodes.bridge', '--ros-args', *words]
        environment = {**os.environ, 'TACTILE_RUN_DIR': str(folder), 'TACTILE_KEYS': str(keys)}
        self.bridge = subprocess.Popen(['ip', 'netns', 'exec', namespace, *program], env=environment)
        self.agent = Other(folder, 0)

    def close(self) -> None:
        self.bridge.terminate()
        assert self.bridge.wait(5.0) == 0
        self.agent.end()


@pytest.fixture
def machines(cable: tuple[str, str], tmp_path: Path) -> Iterator[tuple[Machine, Machine]]:
    for name in ('robot', 'lab'):
        create_keys(name, tmp_path)
    with tempfile.TemporaryDirectory(prefix='tb') as folder:
        robot = Machine(cable[0], Path(folder) / 'a', tmp_path, f'listen:={ROBOT}:7460', 'key:=robot', 'peers:=[lab]')
        lab = Machine(cable[1], Path(folder) / 'b', tmp_path, f'connect:={ROBOT}:7460', 'key:=lab', 'peers:=[robot]')
        yield robot, lab
        lab.close()
        robot.close()


def test_topics_and_services_cross_a_network_and_come_back_after_the_cable_was_pulled(
    machines: tuple[Machine, Machine], cable: tuple[str, str]
) -> None:
    robot, lab = (machine.agent for machine in machines)
    robot.advertise('/n')
    robot.add_node('/camera')
    robot.serve('/camera/tare', 'answer')
    lab.listen('/n')
    numbers = iter(range(1, 1_000_000))
    until(lambda: robot.say('/n', next(numbers)) or lab.heard('/n'), timeout_s=15.0)
    assert lab.call('/camera/tare', 5.0) == f'from {robot.pid()}'
    _ip('-n', cable[0], 'link', 'set', cable[0], 'down')
    until(lambda: '/camera' not in lab.nodes(), 'the other machine to be missed')
    _ip('-n', cable[0], 'link', 'set', cable[0], 'up')
    before = len(lab.heard('/n'))
    until(lambda: robot.say('/n', next(numbers)) or len(lab.heard('/n')) > before, 'it to be heard again', 15.0)
    until(lambda: '/camera' in lab.nodes())
