"""Starts the sensors of a hand: a live launch for each, in its own namespace, and restarts it when it has ended.

For pictures played from a bag, it starts the computing part of the replay launch.

Problems of a sensor (a camera that is not connected, a missing model file) are reported in ``/diagnostics``, as
``launch`` below its name, and do not end the other sensors. The camera node handles a camera that is away for a while.
A sensor that was restarted works again as soon as its motion features get pictures.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Diagnostics, Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.launching.again import LaunchedAgain
from tactile_nodes.launching.hand import arguments_of, parameter_text
from tactile_nodes.launching.processes.output import Line, Screen, print_line
from tactile_nodes.launching.service import LaunchService
from tactile_nodes.params import parameter
from tactile_nodes.paths import log_directory, share_directory
from tactile_nodes.sensors import HandSensor, load_hand

REPORT_PERIOD_S = 1.0
WAITS_S = 60.0


@dataclass(frozen=True)
class HandSensorsParams(NodeParams):
    READ_ONLY: ClassVar[bool] = True

    hand: str = parameter('two_fingers', 'name of a shipped hand, or its file')
    views: bool = parameter(False, 'publish the topics that RViz and Foxglove draw, for each sensor')
    monitor: bool = parameter(True, 'monitor whether the calibration of each sensor is still valid')
    replay: bool = parameter(False, 'compute forces from pictures that are played from a bag')


class HandSensorsNode(Node):
    """One launch per sensor, each in a thread that starts its processes and passes on their output."""

    NAME = 'hand_sensors'
    PARAMS = HandSensorsParams
    END_WITHIN_S = 4.8  # the nodes of the sensors end first; a launch sends the next signal after 5 s

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._hand = load_hand(self.params.hand)
        logs = log_directory() / 'hand'
        logs.mkdir(parents=True, exist_ok=True)
        self._folder = tempfile.TemporaryDirectory(prefix='parameters_', dir=logs)
        for number, refused in enumerate(self._hand.refused):
            self.report(f'left out {number + 1}', Level.ERROR, refused)
        if self._hand.doubted:
            self.report('poses', Level.WARN, self._hand.doubted)
        self._launches = {sensor: self._launched(sensor) for sensor in self._hand.sensors}
        self._healths = {sensor: self._health(sensor) for sensor in self._hand.sensors}
        self._diagnostics = self.create_publisher(topics.DIAGNOSTICS)
        self.create_subscription(topics.DIAGNOSTICS, self._on_diagnostics)
        for each in self._launches.values():
            each.start()
        self.create_timer(REPORT_PERIOD_S, self._report)

    def stop(self) -> None:
        """Also ends all sensors, at the same time."""
        for each in self._launches.values():
            each.stop()
        super().stop()

    def on_close(self) -> None:
        for each in self._launches.values():
            each.join(self.END_WITHIN_S)
        self._folder.cleanup()

    def _health(self, sensor: HandSensor) -> Diagnostics:
        """Diagnostics below the name of the sensor; also of its camera, unless pictures are played."""
        health = Diagnostics(f'{self._below(sensor)}/launch')
        if not self.params.replay:
            health.hardware['sensor'] = sensor.source
        return health

    def _on_diagnostics(self, received: Received) -> None:
        measured = {each.name for each in received.message.status if each.level == Level.OK}
        for sensor, launch in self._launches.items():
            if f'{self._below(sensor)}/flow_features: pictures' in measured:
                launch.report_works()

    def _below(self, sensor: HandSensor) -> str:
        """The namespace of a sensor, as in the names of its diagnostics."""
        return f'{self.names.namespace.rstrip("/")}/{sensor.name}'.lstrip('/')

    def _report(self) -> None:
        for sensor, launch in self._launches.items():
            trouble, health = launch.trouble, self._healths[sensor]
            level = Level.ERROR if trouble else Level.OK
            if health.report('sensor', level, trouble or f'pictures from {sensor.source}') and trouble:
                self.log.error(f'{sensor.name}: {trouble}')
            self._diagnostics.publish(health.message(self.clock.now_ns()))

    def _launched(self, sensor: HandSensor) -> LaunchedAgain:
        def show(line: Line) -> None:
            print_line(Line(sensor.name, str(line)))

        return LaunchedAgain(lambda screen, number: self._service(sensor, screen, number), show)

    def _service(self, sensor: HandSensor, screen: Screen, number: int) -> LaunchService:
        """The first launch reports at once what is missing. Others wait for it, since starting slows all sensors."""
        file = Path(self._folder.name) / f'{sensor.name}.yaml'
        file.parent.mkdir(parents=True, exist_ok=True)  # somebody may have cleared the logs
        file.write_text(parameter_text(sensor, self._hand, open_within_s=WAITS_S if number else 0.0), 'utf-8')
        arguments = arguments_of(sensor, self.names.namespace, file)
        if self.params.replay:
            arguments = {name: arguments[name] for name in ('namespace', 'sensor', 'model', 'config')}
            arguments |= {'bag': '', 'play': 'false'}
        else:
            arguments |= {name: str(getattr(self.params, name)).lower() for name in ('views', 'monitor')}
        launch = share_directory() / 'launch' / f'{"replay" if self.params.replay else "live"}.launch.yaml'
        return LaunchService(launch, arguments, screen=screen, log_base=log_directory() / 'hand' / sensor.name)


main = partial(run_node, HandSensorsNode)
