"""A process on the other side, and a bridge on this one, in a DDS domain that no other test is in."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from dds_sides import Other, OtherAgain
from older_side import LIBRARY

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.nodes.dds_bridge import DdsBridgeNode


@pytest.fixture(scope='session')
def cyclone() -> None:
    """Skips what needs the extra where it is not installed."""
    pytest.importorskip('cyclonedds', reason="Cyclone DDS is not installed: pip install 'tactile_nodes[dds]'")


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """Workers of one test run are in domains of their own. (Ports of those above 101 may be taken.)"""
    number = 20 + os.getpid() % 80
    monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE', raising=False)
    return number


@pytest.fixture(scope='module')
def others(cyclone: None) -> Iterator[OtherAgain]:
    made = OtherAgain()
    yield made
    made.end()


@pytest.fixture
def other(others: OtherAgain, domain: int) -> Iterator[Other]:
    others.begin(domain)
    yield others
    others.end_this()


@contextmanager
def _started_later(program: str) -> Iterator[Callable[[], Other]]:
    started: list[Other] = []

    def start() -> Other:
        started.append(Other(program))
        return started[-1]

    yield start
    for made in started:
        made.end()


@pytest.fixture
def later(cyclone: None, domain: int) -> Iterator[Callable[[], Other]]:
    """Start a process with the bridge's own Cyclone DDS, at a time of the test's choice."""
    with _started_later('ros_side.py') as start:
        yield start


@pytest.fixture
def older(cyclone: None, domain: int) -> Iterator[Callable[[], Other]]:
    """Start a process with the Cyclone DDS of ROS 2 Jazzy (0.10), at a time of the test's choice."""
    try:
        ctypes.CDLL(LIBRARY)
    except OSError:
        pytest.skip('Cyclone DDS 0.10, as ROS 2 has it, is not installed: apt-get install libddsc0debian')
    with _started_later('older_side.py') as start:
        yield start


@pytest.fixture
def bus() -> Iterator[InProcessBus]:
    made = InProcessBus()
    yield made
    made.close()


@pytest.fixture
def bridge(cyclone: None, domain: int, bus: InProcessBus, spinning: Callable[[Node], Node]) -> Callable[..., Node]:
    """Start a bridge in a thread: ``bridge('take:=[/wrench]')``."""

    def start(*parameters: str) -> Node:
        words = [word for each in parameters for word in ('-p', each)]
        return spinning(DdsBridgeNode(bus, parse_arguments(['--ros-args', *words])))

    return start
