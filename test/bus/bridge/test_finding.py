"""Bridges that look for each other, and what answers them or does not."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from agents import until

from tactile_nodes.bus.bridge import finding
from tactile_nodes.bus.bridge.finding import Finder, Group
from tactile_nodes.bus.bridge.link import OPEN, Address, open_session

NEIGHBOUR = '127.0.0.2'  # of this machine's loopback network, and not the address that its interface has
OLDER = '1'


@pytest.fixture
def finder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Finder]:
    monkeypatch.setattr(finding, 'PATIENCE_S', 0.0)
    made = Finder(Group(Address('127.0.0.1', 7499)), OPEN, '')
    yield made
    made.close()


def hear(finder: Finder, port: int) -> None:
    """An older bridge says where it listens."""
    finder._hear(SimpleNamespace(zid=OLDER, locators=[f'tcp/{NEIGHBOUR}:{port}']))


def test_one_that_is_silent_keeps_nobody_waiting(finder: Finder) -> None:
    """A node looks between two of its other duties; one that waited here for a second did not end when asked to."""
    with socket.create_server((NEIGHBOUR, 0)) as silent:
        silent.settimeout(5.0)
        hear(finder, silent.getsockname()[1])
        assert finder.missing([]) == []
        connection, _ = silent.accept()
        with connection:  # it is being tried, and nobody waits for what comes of it
            assert finder.missing([]) == []
            assert finder._trying is not None
            assert finder._trying.is_alive()


def test_one_that_answers_is_reported_once(finder: Finder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(finding.AT_ONCE, 'connect/timeout_ms', 20_000)  # it is tried once here, on a busy machine, too
    with socket.create_server((NEIGHBOUR, 0)) as free:
        port = free.getsockname()[1]
    session = open_session(Address(NEIGHBOUR, port))
    hear(finder, port)
    assert until(lambda: finder.missing([])) == [Address(NEIGHBOUR, port)]
    assert finder.missing([]) == []
    session.close()


def test_one_that_is_connected_is_not_tried(finder: Finder) -> None:
    hear(finder, 7498)
    assert finder.missing([OLDER]) == []
    assert finder._trying is None
