"""A replay measures each picture against the rest image of the live run, also against one that was renewed."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
from feeding import START_NS, image, run

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.messages import types
from tactile_nodes.nodes.flow_features import FlowFeaturesNode

sys.path.insert(0, str(Path(__file__).parents[1] / 'sensing'))
from dots import picture, press, shift, turn

FORCE = types.ForceDistribution
Run = tuple[Mapping[int, list[tuple[object, ...]]], Mapping[int, list[types.Image]]]
"""What was measured of each picture, and the rest images that came with it."""
FRAMES, CAPTURED, KNOCKED = 34, 4, 6
TOUCH, KNOCK = press(200, 230, 0.8), (shift(1.3, -0.6), turn(0.5))


@functools.cache
def frame(number: int) -> types.Image:
    """The camera is knocked, and later the gel is touched."""
    motions = [*([TOUCH] if number >= FRAMES - 2 else []), *(KNOCK if number >= KNOCKED else [])]
    return image(picture(*motions, number=number), START_NS + number * 10**9 // 30)


class Measured:
    """A node, and what it makes of the pictures and rest images that are published to it."""

    def __init__(self, *parameters: str) -> None:
        self.bus = InProcessBus(SteppedClock(START_NS))
        self._features, self._references = self._listen(topics.FLOW_FEATURES), self._listen(topics.REFERENCE_IMAGE)
        self._publishers = {
            topic.name: self.bus.advertise(f'/{topic.name}', topic.type_name, topic.qos)
            for topic in (topics.IMAGE, topics.REFERENCE_IMAGE)
        }
        words = [word for each in ('compiled:=false', 'reference_frames:=4', *parameters) for word in ('-p', each)]
        self._node = FlowFeaturesNode(self.bus, parse_arguments(['--ros-args', *words]), SteppedClock(START_NS))
        self.renewed = list[types.Image]()

    def of(self, topic: Topic, message: types.Image) -> list[tuple[object, ...]]:
        """Publish it; all that matters of the features that follow."""
        self._publishers[topic.name].publish(message)
        run(self._node)
        while (reference := self._references.take()) is not None:
            self.renewed.append(reference.message)
        found = (received.message for received in iter(self._features.take, None))
        return [
            (each.values.tobytes(), each.reasons, each.moved, each.picture_motion.tobytes(), each.reference_id)
            for each in found
            if not each.reasons & FORCE.REASON_NO_REFERENCE
        ]

    def _listen(self, topic: Topic) -> Subscription:
        return self.bus.subscribe(f'/{topic.name}', topic.type_name, Qos('queue', 100))


@pytest.fixture(scope='module')
def live() -> Iterator[Run]:
    node = Measured()
    found, references = dict[int, list[tuple[object, ...]]](), dict[int, list[types.Image]]()
    for number in range(FRAMES):
        found[number] = node.of(topics.IMAGE, frame(number))
        references[number], node.renewed = node.renewed, []
    assert next(number for number, each in references.items() if each) == CAPTURED - 1
    assert sum(map(len, references.values())) > 1  # the knocked one has a rest image of its own
    assert np.frombuffer(found[FRAMES - 1][0][0], np.float32).max() > 0.1
    yield found, references
    node.bus.close()


@pytest.mark.parametrize('first', ['picture', 'rest image'])
def test_a_picture_after_a_knock_is_measured_as_live(first: str, live: Run) -> None:
    """Whether the renewed rest image comes before the picture of its stamp, as on a busy machine, or after it."""
    found, references = live
    node = Measured('reference:=topic')
    for number in range(FRAMES):
        rest_images = [] if number < CAPTURED else references[number]
        if number == CAPTURED:
            node.of(topics.REFERENCE_IMAGE, references[CAPTURED - 1][0])
        if first == 'rest image':
            for each in rest_images:
                node.of(topics.REFERENCE_IMAGE, each)
        assert node.of(topics.IMAGE, frame(number)) == found[number], number
        if first == 'picture':
            for each in rest_images:
                node.of(topics.REFERENCE_IMAGE, each)
    node.bus.close()
