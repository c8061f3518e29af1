"""Presses of a rig in, a calibration out, taken over by the running force estimator; or the reason why not."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from feeding import START_NS, given, image, run
from press_bags import OTHER, Sensor

from tactile_nodes import conversions
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Publisher, Qos, Reply
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.messages import services, stamp_ns, types
from tactile_nodes.model_file import load_model
from tactile_nodes.nodes.calibrator import CalibratorNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.pipeline.ready_model import Inputs

Advertise = Callable[[Topic], Publisher]
PRESSES = 5


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))


@pytest.fixture
def make(
    bus: InProcessBus, clock: SteppedClock, first_model: Path, tmp_path: Path
) -> Iterator[Callable[..., CalibratorNode]]:
    """A calibrator of the small model, for a gel named gel-7."""
    made: list[CalibratorNode] = []

    def calibrator(**more: object) -> CalibratorNode:
        values = {'model': first_model, 'gel': 'gel-7', 'folder': tmp_path / 'calibration', **more}
        made.append(CalibratorNode(bus, given(*(f'{name}:={value}' for name, value in values.items())), clock))
        return made[-1]

    yield calibrator
    for node in made:
        node.close()


def features(model: Path) -> Any:
    """A frame of the untouched gel, as a model needs it."""
    needed = Inputs.of_model(load_model(model))
    layout, (width, height) = needed.layout, needed.image_size
    return types.FlowFeatures(
        header=conversions.header(START_NS, 'camera'), method=needed.method,
        rows=layout.rows, cols=layout.cols, channels=layout.channels, encoding=layout.encoding,
        values=np.zeros(layout.count, np.float32), confidence=np.ones(layout.rows * layout.cols, np.float32),
        image_width=width, image_height=height,
    )  # fmt: skip


def ended(node: CalibratorNode, meanwhile: Callable[[], None] = lambda: None) -> CalibratorNode:
    """The node, once its calibration is over, which has a thread of its own."""
    run(node)
    while node._thread.is_alive():
        meanwhile()
        node._thread.join(0.5)
        run(node)
    return node


class Rig:
    """Tells what a bag holds, and what a rig at rest tells once it was asked to end."""

    def __init__(self, bus: InProcessBus, clock: SteppedClock, advertise: Advertise) -> None:
        self.stops = 0
        self._clock = clock
        published = (topics.PRESS, topics.PRESS_IMAGE, topics.REFERENCE_IMAGE, topics.RIG_STATE)
        self._publishers = {f'/{topic.name}': advertise(topic) for topic in published}
        bus.serve('/rig/stop', services.TRIGGER, self._stop)

    def press(self, bag: Path, node: CalibratorNode, most: int = 1000) -> None:
        """What the bag tells of so many presses; a second goes by after each."""
        with BagReader(bag) as reader:
            for message in reader.messages(list(self._publishers)):
                self._publishers[message.topic].publish_bytes(message.data)
                run(node)
                if message.topic == f'/{topics.PRESS.name}':
                    most -= 1
                    self._clock.set_ns(self._clock.now_ns() + NS_PER_S)
                    node.spin_once()
                if not most:
                    return

    def leave(self) -> None:
        """Its process is gone."""
        for publisher in self._publishers.values():
            publisher.close()

    def rest(self) -> None:
        """A state a tenth of a second later."""
        self._clock.set_ns(self._clock.now_ns() + NS_PER_S // 10)
        state = types.RigState(header=conversions.header(self._clock.now_ns(), 'rig'), depth=-0.01)
        self._publishers[f'/{topics.RIG_STATE.name}'].publish(state)

    def _stop(self, request: Any, reply: Reply) -> None:
        self.stops += 1
        reply(types.Trigger_Response(success=True, message='stopping'))


@pytest.mark.timeout(180)  # a fit takes seconds of a processor, more of one with other work
def test_the_running_force_estimator_takes_over_and_answers_every_frame(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, make: Callable[..., CalibratorNode],
    first_model: Path, other_bag: Path, tmp_path: Path,
) -> None:  # fmt: skip
    """Also if the file of its model is gone by then."""
    forces = bus.subscribe('/force_distribution', topics.FORCE_DISTRIBUTION.type_name, Qos('queue', 1_000_000))
    in_use = tmp_path / 'in_use.safetensors'
    in_use.write_bytes(first_model.read_bytes())
    arguments = given(f'model:={in_use}', 'compiled:=false')
    estimator, source = ForceEstimatorNode(bus, arguments, clock), publisher(topics.FLOW_FEATURES)
    in_use.unlink()
    still = features(first_model)
    sent: list[int] = []

    def frame() -> None:
        rig.rest()
        message = dataclasses.replace(still, header=conversions.header(START_NS + len(sent), 'camera'))
        sent.append(START_NS + len(sent))
        source.publish(message)
        run(estimator)

    rig = Rig(bus, clock, publisher)
    node = make(**{'rule.most': PRESSES, 'rule.first': PRESSES})
    frame()
    rig.press(other_bag, node, most=PRESSES)
    ended(node, frame)
    frame()

    assert node.failure is None
    assert rig.stops == 1
    file = Path(node.params.folder) / 'gel-7_01.safetensors'
    calibrated, old = load_model(file), load_model(first_model)
    assert (calibrated.gel, calibrated.card['source']['model_id']) == ('gel-7', old.model_id)
    found = [received.message for received in iter(forces.take, None)]
    assert [stamp_ns(each.header.stamp) for each in found] == sent
    names = [each.provenance.model_id for each in found]
    assert names == sorted(names, key=[old.model_id, calibrated.model_id].index)
    assert (names[0], names[-1]) == (old.model_id, calibrated.model_id)
    assert estimator.params.model == str(file)


@pytest.mark.timeout(180)  # a fit takes seconds of a processor, more of one with other work
def test_a_person_ends_it_also_while_the_rig_sends_no_press(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, make: Callable[..., CalibratorNode], other_bag: Path
) -> None:
    """The rig is paused, or waits for somebody to look at it."""
    rig, node = Rig(bus, clock, publisher), make(**{'rule.first': 100})
    rig.press(other_bag, node, most=PRESSES)
    while node._session.calibrator.presses < PRESSES:
        node._thread.join(0.1)
    node._finish()
    ended(node, rig.rest)
    assert node.failure is None
    assert rig.stops == 1
    assert (Path(node.params.folder) / 'gel-7_01.safetensors').is_file()


def test_a_rig_that_is_gone_after_too_few_presses_is_reported_as_such(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, make: Callable[..., CalibratorNode], other_bag: Path
) -> None:
    rig, node = Rig(bus, clock, publisher), make()
    rig.press(other_bag, node, most=4)
    rig.leave()
    clock.set_ns(clock.now_ns() + NS_PER_S)
    node.spin_once()
    ended(node)
    assert 'needs presses at least at 5 places, but there are 4' in str(node.failure)


@pytest.mark.parametrize(
    ('has_rig', 'from_bag', 'stops'),
    [
        pytest.param(True, False, 1, id='the rig is ended'),
        pytest.param(True, True, 0, id='of a bag'),
        pytest.param(False, False, None, id='no rig'),
    ],
)
def test_a_sensor_with_other_features_is_refused_and_from_a_bag_a_running_rig_is_left_alone(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, make: Callable[..., CalibratorNode],
    first_model: Path, other_bag: Path, has_rig: bool, from_bag: bool, stops: int | None,
) -> None:  # fmt: skip
    rig, source = Rig(bus, clock, publisher) if has_rig else None, publisher(topics.FLOW_FEATURES)
    node = make(bag=other_bag) if from_bag else make()
    source.publish(dataclasses.replace(features(first_model), method='dis(preset=medium)'))
    run(node)
    assert 'than the running sensor publishes: the flow inverse_comp' in str(node.failure)
    assert ' and not dis(preset=medium);' in str(node.failure)
    assert (rig.stops if rig else None) == stops


@pytest.mark.parametrize('reads', [False, True], ids=['before there are enough presses', 'while it reads a bag'])
def test_a_calibrator_that_somebody_ends_writes_nothing_and_has_not_failed(
    make: Callable[..., CalibratorNode], other_bag: Path, tmp_path: Path, reads: bool
) -> None:
    node = make(bag=other_bag) if reads else make()
    run(node)
    assert node._thread.is_alive()
    node.close()
    node._thread.join(30.0)  # a press or a fit under way
    assert not node._thread.is_alive()
    assert node.failure is None
    assert not list((tmp_path / 'calibration').glob('*.safetensors'))


def test_presses_of_a_bag_on_another_gel_than_the_running_one_are_refused(
    publisher: Advertise, make: Callable[..., CalibratorNode], other_bag: Path
) -> None:
    third = Sensor(dataclasses.replace(OTHER, seed=3))
    publisher(topics.REFERENCE_IMAGE).publish(image(third.rest()))
    node = ended(make(bag=other_bag))
    assert 'the running sensor shows other markers' in str(node.failure)


@pytest.mark.parametrize(
    ('name', 'value', 'refusal'),
    [
        ('model', 'paper', 'only an axisymmetric response can be transferred'),
        ('output', '{folder}', 'it is a folder'),
        ('output', '{folder}/mine.onnx', 'tactile model export'),
        ('output', '{model}', 'is read for it'),
    ],
)
def test_what_cannot_become_of_it_ends_the_node_before_anything_is_pressed(
    make: Callable[..., CalibratorNode], tmp_path: Path, first_model: Path, name: str, value: str, refusal: str
) -> None:
    with pytest.raises((ModelError, ConfigurationError), match=refusal):
        make(**{name: value.format(folder=tmp_path, model=first_model)})
