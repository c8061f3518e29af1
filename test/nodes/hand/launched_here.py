"""A launch file whose nodes run in the process of the test, those of the sensors of its hand included."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.launching.processes.output import Line, Screen
from tactile_nodes.launching.processes.plan import ProcessPlan
from tactile_nodes.launching.service import LaunchService
from tactile_nodes.nodes.composed import node_class
from tactile_nodes.nodes.hand import hand_sensors


class OnlyPlanned:
    """In the place of `LaunchedAgain`."""

    trouble = ''

    def __init__(self, make: Callable[[Screen, int], LaunchService], screen: Screen) -> None:
        planned(make(screen, 0))

    def start(self) -> None:
        """Its processes are planned."""

    def report_works(self) -> None:
        """They work, or the test fails."""

    def stop(self) -> None:
        """They are nodes of the test."""

    def join(self, within_s: float) -> None:
        """As above."""


def run_here(monkeypatch: pytest.MonkeyPatch, file: Path, folder: Path, **arguments: str) -> int:
    """The status that the first of its nodes ends with; logs are below the folder."""
    plans: list[ProcessPlan] = []
    monkeypatch.setenv('ROS_LOG_DIR', str(folder))
    monkeypatch.setattr(LaunchService, 'start', lambda _, plan: plans.append(plan))
    monkeypatch.setattr(hand_sensors, 'LaunchedAgain', OnlyPlanned)
    said: list[Line] = []
    planned(LaunchService(file, arguments, screen=said.append))
    bus, nodes, cameras = InProcessBus(), list[Node](), list[ProcessPlan]()
    for plan in plans:  # some of which a node among them adds
        if 'camera' in Path(plan.command[0]).name:
            cameras.append(plan)
        else:
            nodes += nodes_of(plan, bus)
    for plan in cameras:  # last: each waits, the longer the busier the machine is, for who takes its first pictures
        nodes += nodes_of(plan, bus)
    try:
        return run_until(nodes, threading.Event())
    finally:
        bus.close()


def planned(service: LaunchService) -> None:
    service.load()
    service._log.close()


def nodes_of(plan: ProcessPlan, bus: InProcessBus) -> list[Node]:
    program, *words = plan.command
    composed = list(itertools.takewhile(lambda word: word != '--ros-args', words))
    names = composed or [Path(program).name.removeprefix('tactile_')]
    return [node_class(name)(bus, parse_arguments(words[len(composed) :])) for name in names]
