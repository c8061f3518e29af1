"""Bridges between machines on a switch: network namespaces and virtual Ethernet devices."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from agents import DEADLINE_S, Other, until

from tactile_nodes.bus.bridge.keys import create_keys

NETWORK = '10.213.9'
ROBOT = f'{NETWORK}.1'


def _ip(*words: str) -> None:
    subprocess.run(['ip', *words], check=True, capture_output=True)


@pytest.fixture
def switch() -> Iterator[list[str]]:
    """The names of three network namespaces, connected to one switch."""
    if shutil.which('ip') is None:
        pytest.skip('network namespaces need the program ip (Debian package iproute2)')
    switch, names = f'tn{os.getpid()}s', [f'tn{os.getpid()}{letter}' for letter in 'abc']
    try:
        _ip('netns', 'add', switch)
        _ip('-n', switch, 'link', 'add', switch, 'type', 'bridge')
        _ip('-n', switch, 'link', 'set', switch, 'up')
        for number, name in enumerate(names, 1):
            _ip('netns', 'add', name)
            _ip('link', 'add', name, 'type', 'veth', 'peer', 'name', f'{name}s')
            _ip('link', 'set', name, 'netns', name)
            _ip('link', 'set', f'{name}s', 'netns', switch)
            _ip('-n', switch, 'link', 'set', f'{name}s', 'master', switch, 'up')
            _ip('-n', name, 'address', 'add', f'{NETWORK}.{number}/24', 'dev', name)
            _ip('-n', name, 'link', 'set', name, 'up')
        yield names
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('network namespaces are not permitted here')
    finally:
        for name in (switch, *names):
            subprocess.run(['ip', 'netns', 'delete', name], check=False, capture_output=True)


class Machine:
    """A folder of sockets and a bridge in a network namespace."""

    def __init__(self, namespace: str, folder: Path, keys: Path, *parameters: str) -> None:
        folder.mkdir(mode=0o700)
        self.folder = folder
        words = [word for parameter in parameters for word in ('-p', parameter)]
        program = [sys.executable, '-m', 'tactile_nodes.nodes.composed', 'bridge', '--ros-args', *words]
        environment = {**os.environ, 'TACTILE_RUN_DIR': str(folder), 'TACTILE_KEYS': str(keys)}
        self.bridge = subprocess.Popen(['ip', 'netns', 'exec', namespace, *program], env=environment)
        self.agent = Other(folder, 0)

    def close(self) -> None:
        self.bridge.terminate()
        assert self.bridge.wait(DEADLINE_S) == 0
        self.agent.end()


@pytest.fixture
def machines(switch: list[str], tmp_path: Path) -> Iterator[tuple[Machine, Machine]]:
    for name in ('robot', 'lab'):
        create_keys(name, tmp_path)
    with tempfile.TemporaryDirectory(prefix='tb') as folder:
        robot = Machine(switch[0], Path(folder) / 'a', tmp_path, f'listen:={ROBOT}:7460', 'key:=robot', 'peers:=[lab]')
        lab = Machine(switch[1], Path(folder) / 'b', tmp_path, f'connect:={ROBOT}:7460', 'key:=lab', 'peers:=[robot]')
        yield robot, lab
        lab.close()
        robot.close()


def test_topics_and_services_cross_a_network_and_come_back_after_the_cable_was_pulled(
    machines: tuple[Machine, Machine], switch: list[str]
) -> None:
    robot, lab = (machine.agent for machine in machines)
    robot.add_node('/camera')
    robot.serve('/camera/tare', 'answer')
    robot.advertise('/n')  # whoever knows of it knows the rest
    lab.listen('/n')
    numbers = iter(range(1, 1_000_000))
    until(lambda: robot.say('/n', next(numbers)) or lab.received('/n'))
    assert lab.call('/camera/tare') == f'from {robot.pid()}'
    _ip('-n', switch[0], 'link', 'set', switch[0], 'down')
    until(lambda: '/camera' not in lab.nodes(), 'the other machine to be missed')
    _ip('-n', switch[0], 'link', 'set', switch[0], 'up')
    before = len(lab.received('/n'))
    until(lambda: robot.say('/n', next(numbers)) or len(lab.received('/n')) > before, 'it to be heard again')
    until(lambda: '/camera' in lab.nodes())


LOOKING = 'listen:=0.0.0.0:7460', 'discover:=true'


def test_those_that_look_for_each_other_need_no_address_and_a_stranger_finds_nobody(
    switch: list[str], tmp_path: Path
) -> None:
    for name in ('robot', 'lab', 'stranger'):
        create_keys(name, tmp_path)
    with tempfile.TemporaryDirectory(prefix='tb') as folder, ExitStack() as stack:

        def machine(number: int, name: str, *peers: str, again: str = '') -> Machine:
            words = *LOOKING, f'key:={name}', f'peers:=[{", ".join(peers)}]'
            made = Machine(switch[number], Path(folder) / f'{number}{again}', tmp_path, *words)
            made.agent.add_node(f'/{name}{again}')
            return made

        def seen_by(one: Machine) -> set[str]:
            return set(one.agent.nodes()) & {'/robot', '/lab', '/lab2', '/stranger'}

        stranger = machine(2, 'stranger', 'robot', 'lab')
        robot = machine(0, 'robot', 'lab')
        lab = machine(1, 'lab', 'robot')
        for one in (robot, stranger):
            stack.callback(one.close)
        for one in (robot, lab):
            until(lambda one=one: seen_by(one) == {'/robot', '/lab'}, 'both', 60.0)
        lab.close()
        lab = machine(1, 'lab', 'robot', again='2')
        stack.callback(lab.close)
        for one in (robot, lab):
            until(lambda one=one: seen_by(one) == {'/robot', '/lab2'}, 'both after a restart', 60.0)
        assert seen_by(stranger) == {'/stranger'}


@pytest.mark.parametrize('address', [f'{NETWORK}.9:7460', 'nowhere.example:7460'])
def test_a_bridge_whose_other_host_is_silent_ends_in_time(switch: list[str], tmp_path: Path, address: str) -> None:
    """Packets to the other host, and to the server of names, are lost without a word."""
    for name in ('robot', 'lab'):
        create_keys(name, tmp_path)
    silent = f'{NETWORK}.9'
    _ip('-n', switch[0], 'neigh', 'add', silent, 'lladdr', '02:00:00:00:00:09', 'dev', switch[0], 'nud', 'permanent')
    _ip('-n', switch[0], 'route', 'add', 'default', 'via', silent)
    with tempfile.TemporaryDirectory(prefix='tb') as folder:
        words = f'connect:={address}', 'key:=lab', 'peers:=[robot]'
        machine = Machine(switch[0], Path(folder) / 'a', tmp_path, *words)
        until(lambda: '/bridge' in machine.agent.nodes(), 'the bridge')
        machine.close()
