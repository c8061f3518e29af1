"""What the bridge node reports of several machines; the bridge itself is left out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.clock import SteppedClock
from tactile_nodes.nodes import bridge
from tactile_nodes.nodes.bridge import BridgeNode


@pytest.fixture
def linked(bus: InProcessBus, clock: SteppedClock, monkeypatch: pytest.MonkeyPatch) -> BridgeNode:
    """A node whose bridge connects two machines; the clock of the first is 20 ms ahead."""
    machines = [('robot', SimpleNamespace(ahead_ns=20_000_000)), ('lab', SimpleNamespace(ahead_ns=None))]
    made = SimpleNamespace(connected=lambda: machines, malformed=0, strangers={}, close=lambda: None)
    monkeypatch.setattr(bridge, 'ZmqBus', InProcessBus)
    monkeypatch.setattr(BridgeNode, '_opened', lambda _: made)
    return BridgeNode(bus, parse_arguments(['--ros-args', '-p', 'listen:=127.0.0.1:7460']), clock)


def status(node: BridgeNode, part: str) -> Any:
    (found,) = (each for each in node.diagnostics.message(0).status if each.name == f'bridge: {part}')
    return found


def test_several_machines_are_one_report_that_does_not_change_from_second_to_second(
    linked: BridgeNode, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(5):
        linked._report()
    report = status(linked, 'connection')
    assert report.level == Level.WARN
    assert report.message.startswith('robot: the clocks of both machines differ')
    assert report.message.endswith('; lab: connected')
    assert {each.key: each.value for each in report.values} == {'clock_ahead_ms': '20', 'malformed': '0'}
    assert capsys.readouterr().err.count('connection: ') == 1
    linked.close()


def test_a_machine_that_was_updated_is_no_longer_said_to_be_old(linked: BridgeNode) -> None:
    linked._bridge.strangers['lab'] = '9'
    linked._report()
    assert 'has version 9 of the bridge' in status(linked, 'version').message
    linked._bridge.strangers.clear()
    linked._report()
    assert status(linked, 'version').level == Level.OK
    linked.close()
