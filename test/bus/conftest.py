"""A folder for the sockets of one test, and processes that meet there."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from agents import Other

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.zeromq.host_bus import ZmqBus


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix='tb', ignore_cleanup_errors=True) as name:
        yield Path(name)


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[..., Other]]:
    """Start another process: ``start()``, ``start(domain_id=8)``."""
    others: list[Other] = []

    def make(*args: Any, **more: Any) -> Other:
        others.append(Other(folder, *args, **more))
        return others[-1]

    yield make
    for other in others:
        other.end()


@pytest.fixture
def join(folder: Path) -> Iterator[Callable[..., ZmqBus]]:
    """Join the bus of the test from this process: ``join()``, ``join(8)``."""
    buses: list[ZmqBus] = []

    def make(domain_id: int = 7) -> ZmqBus:
        buses.append(ZmqBus(domain_id, folder=folder))
        return buses[-1]

    yield make
    for bus in buses:
        bus.close()


@pytest.fixture(params=['in one process', 'over ZeroMQ'])
def bus(request: pytest.FixtureRequest, folder: Path) -> Iterator[InProcessBus]:
    """Every transport: what its user may rely on is the same for all."""
    made = InProcessBus() if request.param == 'in one process' else ZmqBus(7, folder=folder)
    yield made
    made.close()
