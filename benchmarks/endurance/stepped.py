"""Hours of sensing in minutes: real nodes on a bus inside one process, with a clock that is moved by the benchmark.

Every frame passes the flow features node, the force estimator and the drift monitor, as in live sensing. The frames
are small pictures of the simulated gel, because eight hours are 1.7 million of them: noise at rest, and a press of one
second each minute. The model has random weights, so its forces mean nothing. But equal forces in the first and the last
hour show that the nodes accumulate no error.
"""

from __future__ import annotations

import gc
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from benchmarks.endurance.live import look
from benchmarks.endurance.trend import Look, growth
from tactile_nodes import conversions, model_file
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types
from tactile_nodes.nodes.drift_monitor import DriftMonitorNode
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.explain.network import InputScaling, Mlp, NetworkReadout
from tactile_nodes.sensing.geometry import BinGrid, centre_crop
from tactile_nodes.simulation.optics import Optics, Press

FPS = 60
SIDE_PX, CROP_PX = 128, 440
PRESS_S = 1
START_NS = 1_000 * NS_PER_S


@dataclass
class Answers:
    """The resulting forces.

    Attributes:
        images: number of images in; forces: number of forces out.
        first, last: total force [N] for each picture of a press, in the first and in the latest press.
        status: numbers of ok, degraded and invalid forces.
    """

    images: int = 0
    forces: int = 0
    first: dict[int, float] = field(default_factory=dict)
    last: dict[int, float] = field(default_factory=dict)
    status: list[int] = field(default_factory=lambda: [0, 0, 0])

    def take(self, message: types.ForceDistribution, picture: int) -> None:
        self.forces += 1
        self.status[message.status] += 1
        if picture >= 0:
            self.first.setdefault(picture, message.total)
            self.last[picture] = message.total

    @property
    def drift_n(self) -> float:
        """Largest change of the force for the same picture [N]."""
        return max((abs(self.last[key] - value) for key, value in self.first.items()), default=float('nan'))


class Pictures:
    """Noise at rest, and in each period a press that goes down and up in a second."""

    def __init__(self, period_s: int, rest_frames: int) -> None:
        self._period = period_s * FPS
        gel = load_gel('paper')
        optics = Optics(gel, contact_table(gel))
        depths_mm = np.sin(np.linspace(0.0, np.pi, FPS * PRESS_S))
        self.rest = [_small(optics.render((), number)) for number in range(rest_frames)]
        self.press = [
            _small(optics.render((Press(2.0, -3.0, float(depth)),), rest_frames + number))
            for number, depth in enumerate(depths_mm)
        ]

    def of(self, frame: int) -> tuple[np.ndarray, int]:
        """The picture of a frame, and its number in the press; -1 at rest."""
        number = frame % self._period - self._period // 2
        if 0 <= number < len(self.press):
            return self.press[number], number
        return self.rest[frame % len(self.rest)], -1


@dataclass
class Watched:
    """Looks at the process, the number of its objects, and the longest queues."""

    looks: list[Look] = field(default_factory=list)
    objects: list[int] = field(default_factory=list)
    longest_work: int = 0
    longest_queue: int = 0


class Pipeline:
    """The nodes of live sensing except the camera, whose frames are published here."""

    def __init__(self, model: Path) -> None:
        self.clock = SteppedClock(START_NS)
        self.bus = InProcessBus(self.clock)
        values = (f'model:={model}', 'check_s:=10.0', 'least_confidence:=0.5')
        words = [word for value in values for word in ('-p', value)]
        chosen = parse_arguments(['--ros-args', *words, '--log-level', 'ERROR'])
        kinds = (FlowFeaturesNode, ForceEstimatorNode, DriftMonitorNode)
        self.nodes: list[Node] = [kind(self.bus, chosen, self.clock) for kind in kinds]
        self._image = self.bus.advertise('/' + topics.IMAGE.name, topics.IMAGE.type_name, topics.IMAGE.qos)
        force = topics.FORCE_DISTRIBUTION
        self._force = self.bus.subscribe('/' + force.name, force.type_name, Qos('queue', 10))

    def frame(self, picture: np.ndarray) -> types.ForceDistribution | None:
        """Process one frame, 1/60 s after the previous one."""
        self.clock.advance(1 / FPS)
        self._image.publish(conversions.image_message(picture, conversions.header(self.clock.now_ns(), 'camera')))
        for node in self.nodes:
            node.spin_once()
            while node._work.qsize():
                node.spin_once()
        received = self._force.take()
        return received.message if received is not None else None

    @property
    def subscriptions(self) -> list[Subscription]:
        """The subscriptions of all nodes."""
        return [entry for entries in self.bus._subscriptions.values() for entry in entries]

    def close(self) -> None:
        """Close the nodes."""
        for node in self.nodes:
            node.close()
        self.bus.close()


def stepped(hours: float, progress: Progress, period_s: int = 60, rest_frames: int = 64) -> dict[str, Any]:
    """Run for `hours` of the simulated clock, with a press and a look at the process in each period."""
    frames, answers, watched = round(hours * 3600 * FPS), Answers(), Watched()
    pictures, process, period = Pictures(period_s, rest_frames), psutil.Process(), FPS * period_s
    if frames < period:
        raise ConfigurationError(f'{hours:g} hours are less than one period of {period_s:g} s; ask for more (--hours)')
    with _pipeline() as pipeline, progress.bar('stepped clock', frames // period) as bar:
        for frame in range(frames):
            picture, number = pictures.of(frame)
            answers.images += 1
            if (message := pipeline.frame(picture)) is not None:
                answers.take(message, number)
            if frame % period == period - 1:
                _watch(watched, process, pipeline, frame / FPS)
                bar.advance(text=f'{watched.looks[-1].memory_mb:.1f} MiB, {answers.forces} forces')
        ends = pipeline.subscriptions
        counts = {name: sum(getattr(end, name) for end in ends) for name in ('received', 'dropped', 'malformed')}
        problems = _problems(pipeline)
    return {
        'hours': hours, 'side_px': SIDE_PX, 'images': answers.images, 'forces': answers.forces,
        'status': dict(zip(('ok', 'degraded', 'invalid'), answers.status, strict=True)), 'drift_n': answers.drift_n,
        'subscriptions': counts, 'longest_work': watched.longest_work, 'longest_queue': watched.longest_queue,
        'objects': {'first': watched.objects[len(watched.objects) // 5], 'last': watched.objects[-1]},
        'problems': problems, 'looks': [asdict(each) for each in watched.looks], **growth(watched.looks),
    }  # fmt: skip


def _watch(watched: Watched, process: psutil.Process, pipeline: Pipeline, at_s: float) -> None:
    watched.longest_work = max(watched.longest_work, *(node._work.qsize() for node in pipeline.nodes))
    watched.longest_queue = max(watched.longest_queue, *(end.waiting for end in pipeline.subscriptions))
    gc.collect()
    watched.objects.append(len(gc.get_objects()))
    watched.looks.append(look(process, at_s))


def _problems(pipeline: Pipeline) -> list[str]:
    """The problems in the diagnostics of the nodes."""
    statuses = (status for node in pipeline.nodes for status in node.diagnostics.message(0).status)
    return [f'{status.name}: {status.message}' for status in statuses if status.level not in {0, b'\0'}]


@contextmanager
def _pipeline() -> Iterator[Pipeline]:
    with tempfile.TemporaryDirectory(prefix='te') as folder:
        made = Pipeline(drawn_model(Path(folder) / 'drawn.safetensors'))
        try:
            yield made
        finally:
            made.close()


def drawn_model(file: Path) -> Path:
    """A model for pictures of this size: 4x4 regions of mean motion, 3x3 bins, random weights."""
    rng, layout, bins = np.random.default_rng(7), FeatureLayout('cartesian_mean', 4, 4, 2), BinGrid(3, 3, 30.0, 30.0)
    weights = (rng.normal(0, 0.2, (16, 32)).astype(np.float32), rng.normal(0, 0.1, (9, 16)).astype(np.float32))
    network = Mlp(weights, (np.zeros(16, np.float32), np.zeros(9, np.float32)))
    ones = np.ones((4, 4, 2), np.float32)
    scaling = InputScaling(np.zeros_like(ones), ones, np.ones((4, 4), np.float32), 0.5)
    card = {
        'flow': {'name': 'dis', 'options': {}},
        'encoding': {'name': 'cartesian_mean', 'options': {'rows': 4, 'cols': 4}},
        'crop_px': SIDE_PX,
        'gel': {'id': 'paper, in small'},
    }
    model_file.save_model(file, ForceModel(layout, bins, NetworkReadout(scaling, network, bins)), card)
    return file


def _small(image: np.ndarray) -> np.ndarray:
    """The middle of an image, with fewer pixels."""
    cut = centre_crop(image, CROP_PX, CROP_PX)
    return np.ascontiguousarray(cv2.resize(cut, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA))
