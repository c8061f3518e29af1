"""A real ``tactile launch live`` with presses that last seconds; its forces are compared with the truth."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.faults.launch import Launch, free_ports
from benchmarks.page.launch import sensing
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.parameters import to_message
from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock
from tactile_nodes.errors import ConfigurationError, MessageError
from tactile_nodes.messages import services, stamp_ns, types
from tactile_nodes.model_file import find_model

CONFIG = """\
/**/camera:
  ros__parameters:
    {{fps: 60.0, crop: 440, wait_s: 2.0,
      scene: {{period_s: {period_s}, start_ns: {start_ns}, shallowest_mm: 1.0, deepest_mm: 1.6}}}}
/**/flow_features: {{ros__parameters: {{reference_frames: 16}}}}
/**/force_estimator: {{ros__parameters: {{least_confidence: 0.85}}}}
"""
SHARE_DOWN, SHARE_LIFTS = 0.4, 0.65
"""Shares of a period at which the tip has arrived, and starts to move up (`simulation.scene.PressSchedule`)."""


@dataclass(frozen=True)
class Seen:
    """One force: its time of publication, the stamp of its image, and its content."""

    published_ns: int
    stamp_ns: int
    status: int
    total_n: float
    reference_id: str
    model: str


@dataclass
class Sensor:
    """A running sensor.

    Attributes:
        launch: its processes.
        bus: the bus of the subscriber.
        clock: the host's clock.
        start_ns: start of its first period.
        period_s: time from press to press.
        page: the address of its page.
        bags: folder of its recorder.
        truths: true force [N], by the stamp of the image.
        malformed: number of invalid messages.
    """

    launch: Launch
    bus: Bus
    clock: Clock
    start_ns: int
    period_s: float
    page: str
    bags: Path
    truths: dict[int, float] = field(default_factory=dict)
    malformed: int = 0

    def __post_init__(self) -> None:
        self._forces = self._subscribe(topics.FORCE_DISTRIBUTION)
        self._truth = self._subscribe(topics.TRUE_FORCE)

    def watch(self, until_ns: int, look: Callable[[], None] = lambda: None) -> list[Seen]:
        """The forces received until `until_ns`; `look` is called at least ten times a second."""
        seen = []
        while self.clock.now_ns() < until_ns:
            received = self._forces.get(0.1)
            look()
            try:
                self._take_truths()
                if received is not None:
                    seen.append(_seen(received))
            except MessageError:
                self.malformed += 1
        return seen

    def await_touch(self) -> None:
        """Wait until the tip has just arrived in the gel, so that the whole contact is left."""
        share = (self.clock.now_ns() - self.start_ns) / NS_PER_S / self.period_s
        number = int(share) + (share % 1.0 > SHARE_DOWN)
        self.watch(self.start_ns + round((number + SHARE_DOWN) * self.period_s * NS_PER_S))

    @property
    def touches_until_ns(self) -> int:
        """The time when the tip starts to move up again."""
        number = (self.clock.now_ns() - self.start_ns) // round(self.period_s * NS_PER_S)
        return self.start_ns + round((number + SHARE_LIFTS) * self.period_s * NS_PER_S)

    def set(self, node: str, name: str, value: str) -> None:
        """Set a parameter. Raises ConfigurationError, ServiceError."""
        wanted = types.SetParameters_Request(parameters=[types.Parameter(name=name, value=to_message(value))])
        for result in self.bus.call(f'{node}/set_parameters', services.SET_PARAMETERS, wanted, 10.0).results:
            if not result.successful:
                raise ConfigurationError(result.reason)

    def call(self, service: str) -> str:
        """Call a trigger service; returns its message. Raises ServiceError."""
        return str(self.bus.call(service, services.TRIGGER, types.Trigger_Request(), 10.0).message)

    def has(self, node: str) -> bool:
        """Whether a node is on the bus."""
        return any(node in each.nodes for each in self.bus.graph().participants)

    def _take_truths(self) -> None:
        while (received := self._truth.take()) is not None:
            self.truths[stamp_ns(received.message.header.stamp)] = received.message.total

    def _subscribe(self, topic: Topic) -> Subscription:
        return self.bus.subscribe(f'/{topic.name}', topic.type_name, Qos('queue', 2000))


def _seen(received: Received) -> Seen:
    force: types.ForceDistribution = received.message
    named = force.provenance
    at_ns = stamp_ns(force.header.stamp)
    return Seen(received.source_ns, at_ns, force.status, force.total, named.reference_id, named.model)


@contextmanager
def sensor(folder: Path, period_s: float, *words: str) -> Iterator[Sensor]:
    """Start a sensor, and wait for its first force; at the end, stop all its processes.

    Raises:
        ConfigurationError: it does not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    clock = SystemClock()
    shutil.copy(find_model('fast'), folder / 'taken_over.safetensors')
    start_ns = clock.now_ns() + 20 * NS_PER_S
    config, (port, _, _) = folder / 'live.yaml', free_ports()
    config.write_text(CONFIG.format(period_s=period_s, start_ns=start_ns), encoding='ascii')
    chosen = (f'config:={config}', f'page_port:={port}', f'bags:={folder}/', 'model:=fast', 'contact:=tip')
    with sensing(*chosen, *words, log=folder / 'launch.log') as running:
        yield Sensor(running.launch, running.bus, clock, start_ns, period_s, running.url, folder)
