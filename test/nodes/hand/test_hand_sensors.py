"""The launches of a hand, as the node makes them, without their processes."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from feeding import run

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.launching.processes.output import Line, Screen
from tactile_nodes.launching.service import LaunchService
from tactile_nodes.messages import types
from tactile_nodes.nodes.hand import hand_sensors
from tactile_nodes.nodes.hand.hand_sensors import HandSensorsNode

Make = Callable[[Screen, int], LaunchService]


class NeverLaunched:
    """A `LaunchedAgain` that only remembers how its launches are made."""

    made: ClassVar[list[Make]] = []
    screens: ClassVar[list[Screen]] = []
    trouble = ''
    working = 0

    def __init__(self, make: Make, screen: Screen) -> None:
        self.made.append(make)
        self.screens.append(screen)

    def start(self) -> None:
        pass

    def report_works(self) -> None:
        type(self).working += 1

    def stop(self) -> None:
        pass

    def join(self, within_s: float) -> None:
        pass


@pytest.fixture
def node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HandSensorsNode]:
    """That of a hand with one sensor, whose logs are below the folder of the test."""
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    monkeypatch.setattr(NeverLaunched, 'made', [])
    monkeypatch.setattr(NeverLaunched, 'screens', [])
    monkeypatch.setattr(hand_sensors, 'LaunchedAgain', NeverLaunched)
    (tmp_path / 'hand.yaml').write_text('sensors: [{name: left, model: fast}]\n')
    words = ['--ros-args', '-p', f'hand:={tmp_path}/hand.yaml']
    node = HandSensorsNode(bus := InProcessBus(), parse_arguments(words))
    yield node
    node.close()
    bus.close()


@pytest.fixture
def makes(node: HandSensorsNode) -> list[Make]:
    """How each of its launches is made."""
    return NeverLaunched.made


def test_a_sensor_works_when_its_features_get_pictures(node: HandSensorsNode, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NeverLaunched, 'working', 0)
    told = node.create_publisher(topics.DIAGNOSTICS)
    for name, level, works in (
        ('left/camera: camera', 0, 0),
        ('right/flow_features: pictures', 0, 0),
        ('left/flow_features: pictures', 1, 0),
        ('left/flow_features: pictures', 0, 1),
    ):
        told.publish(types.DiagnosticArray(status=[types.DiagnosticStatus(name=name, level=level)]))
        run(node)
        assert NeverLaunched.working == works


def test_a_sensor_is_launched_again_after_somebody_has_cleared_the_logs(tmp_path: Path, makes: list[Make]) -> None:
    (make,) = makes
    make(lambda _: None, 0)
    shutil.rmtree(tmp_path / 'log')
    make(lambda _: None, 1)
    assert [file.name for file in tmp_path.glob('log/hand/parameters_*/*')] == ['left.yaml']


@pytest.mark.usefixtures('makes')
def test_a_letter_that_the_terminal_lacks_is_shown_as_its_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, 'stdout', io.TextIOWrapper(written := io.BytesIO(), encoding='latin-1'))
    (screen,) = NeverLaunched.screens
    screen(Line('camera_node-1', 'Kamera geht nicht → prüfen'))
    assert written.getvalue() == b'[left] [camera_node-1] Kamera geht nicht \\u2192 pr\xfcfen\n'
