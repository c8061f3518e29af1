"""Nodes that were killed and started again by the same launch go on with what was decided while they ran."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from feeding import PATTERN, came, image, run

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.keeping import VARIABLE, Kept
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import BusError
from tactile_nodes.messages import types
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode
from tactile_nodes.nodes.recorder import RecorderNode
from tactile_nodes.sensing.rest.reference import content_id

Born = Callable[..., tuple[Node, InProcessBus]]
SMALL: list[str] = []
PRESSED = PATTERN.copy()
PRESSED[40:120, 40:120] = np.roll(PATTERN, 3, axis=1)[40:120, 40:120]
"""The middle, four of the 16 regions, has moved 3 px to the right."""


@pytest.fixture(autouse=True)
def _small(patches_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], 'SMALL', [f'model:={patches_model}', 'reference_frames:=1'])


@pytest.fixture
def launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that a launch names to its processes."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'kept'))
    return tmp_path / 'kept'


@pytest.fixture
def born(clock: SteppedClock) -> Born:
    """A node on a bus of its own: a process that is killed leaves nothing of either."""

    def make(kind: type[Any], *values: str) -> tuple[Node, InProcessBus]:
        bus = InProcessBus(clock)
        words = [word for value in values for word in ('-p', value)]
        return kind(bus, parse_arguments(['--ros-args', *words]), clock), bus

    return make


def features_of(born: Born, pixels: np.ndarray, *values: str) -> types.FlowFeatures:
    """What a new node makes of one image."""
    node, bus = born(FlowFeaturesNode, *SMALL, *values)
    found = bus.subscribe('/flow_features', topics.FLOW_FEATURES.type_name, Qos('queue', 10))
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1))
    camera.publish(image(pixels))
    run(node)
    return came(found)


def test_flow_features_do_not_take_a_touched_gel_for_the_rest_image_after_a_restart(launch: Path, born: Born) -> None:
    features_of(born, PATTERN)  # becomes the rest image
    message = features_of(born, PRESSED)
    assert not message.reasons & types.ForceDistribution.REASON_NO_REFERENCE
    right_px = message.values.reshape(4, 4, 2)[..., 0]
    assert np.median(right_px[1:3, 1:3]) == pytest.approx(3.0, abs=0.5)  # DIS is smooth over the edges


def test_the_restored_rest_image_is_reported_to_those_who_come_later(launch: Path, born: Born) -> None:
    features_of(born, PATTERN)
    _, bus = born(FlowFeaturesNode, *SMALL)
    received = came(bus.subscribe('/reference_image', topics.REFERENCE_IMAGE.type_name, Qos('latest', 1)))
    np.testing.assert_array_equal(received.data, PATTERN.ravel())


def test_a_restored_rest_image_of_a_picture_that_never_rested_is_reported_as_before(
    launch: Path, born: Born, clock: SteppedClock
) -> None:
    tested, bus = born(FlowFeaturesNode, *SMALL, 'reference_frames:=2')
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1))
    for number in range(10):  # four times two frames, one that ends the capture, and one that is measured
        camera.publish(image(np.roll(PATTERN, number % 2, axis=1), clock.now_ns() + number))
        run(tested)
    said = []
    for each in (tested, born(FlowFeaturesNode, *SMALL, 'reference_frames:=2')[0]):
        said += [status for status in each.diagnostics.message(0).status if status.name.endswith(': rest image')]
    assert 'never was still' in said[0].message
    assert (said[1].level, said[1].message) == (said[0].level, said[0].message)


def test_another_launch_captures_its_own_rest_image(
    launch: Path, born: Born, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    features_of(born, PATTERN)
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'another'))
    assert features_of(born, PRESSED).reasons == types.ForceDistribution.REASON_NO_REFERENCE


def test_a_node_that_no_launch_started_keeps_nothing(born: Born, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    features_of(born, PATTERN)
    assert features_of(born, PRESSED).reasons == types.ForceDistribution.REASON_NO_REFERENCE


@pytest.mark.parametrize('data', [b'', b'no message', bytes(4000)])
def test_a_kept_rest_image_that_is_damaged_is_reported_and_a_new_one_captured(
    launch: Path, born: Born, data: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    launch.mkdir()
    (launch / 'flow_features.rest_image').write_bytes(data)
    assert features_of(born, PATTERN).reasons == types.ForceDistribution.REASON_NO_REFERENCE
    assert 'the rest image from before the restart cannot be used' in ''.join(capsys.readouterr())


def features_after_a_knock(born: Born, clock: SteppedClock, killed: bool) -> types.FlowFeatures:
    """Of a frame with something on the gel, long after the camera was knocked, by one node or by two."""
    node, bus = born(FlowFeaturesNode, *SMALL)
    for number in range(14):
        if killed and number == 13:
            node, bus = born(FlowFeaturesNode, *SMALL)
        found = bus.subscribe('/flow_features', topics.FLOW_FEATURES.type_name, Qos('queue', 20))
        pixels = np.roll(PRESSED if number == 13 else PATTERN, 2 if number > 2 else 0, axis=0)
        camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1))
        camera.publish(image(pixels, clock.now_ns()))
        run(node)
        clock.advance(0.5)
    return came(found)


def test_what_flow_features_learned_of_a_knock_is_not_lost_by_a_restart(
    launch: Path, born: Born, clock: SteppedClock
) -> None:
    lived = features_after_a_knock(born, clock, killed=False)
    shutil.rmtree(launch)
    killed = features_after_a_knock(born, clock, killed=True)
    assert lived.moved > 1.9
    assert killed.moved == pytest.approx(lived.moved, abs=0.01)
    np.testing.assert_allclose(killed.values, lived.values, atol=0.02)


def test_what_is_learned_is_kept_also_when_a_bag_begins_again(launch: Path, born: Born, clock: SteppedClock) -> None:
    node, bus = born(FlowFeaturesNode, *SMALL)
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1))

    def show(pixels: np.ndarray) -> bytes:
        for _ in range(2):  # the first becomes the rest image
            camera.publish(image(pixels, clock.now_ns()))
            run(node)
            clock.advance(0.02)
        return (launch / 'flow_features.memory').read_bytes()

    before = show(PATTERN)
    clock.advance(-10.0)
    assert isinstance(node, FlowFeaturesNode)
    node._capture_again()
    assert show(PRESSED) != before


def test_a_kept_memory_that_is_damaged_leaves_the_rest_image(
    launch: Path, born: Born, capsys: pytest.CaptureFixture[str]
) -> None:
    features_of(born, PATTERN)
    assert features_of(born, PATTERN).reasons == 0
    (launch / 'flow_features.memory').write_bytes(b'damaged')
    assert features_of(born, PATTERN).reasons == 0
    assert 'only the rest image was restored' in ''.join(capsys.readouterr())


def test_a_disk_that_is_full_neither_ends_a_restarted_node_nor_hides_its_rest_image(
    launch: Path, born: Born, monkeypatch: pytest.MonkeyPatch
) -> None:
    features_of(born, PATTERN)

    def full(kept: Kept, name: str, data: bytes) -> None:
        raise BusError(f'cannot store {name}: the disk is full')

    monkeypatch.setattr(Kept, 'put', full)
    node, _ = born(FlowFeaturesNode, *SMALL)
    run(node)
    told = {status.name: status.message for status in node.diagnostics.message(0).status}
    assert told['flow_features: rest image'].startswith(content_id(PATTERN))
    assert told['flow_features: errors'] == 'cannot store rest_image: the disk is full'


def test_a_memory_of_another_rest_image_than_the_kept_one_is_not_restored(
    launch: Path, born: Born, capsys: pytest.CaptureFixture[str]
) -> None:
    """A node that is killed less than a second after a capture has kept the new rest image, and the old memory."""
    node, bus = born(FlowFeaturesNode, *SMALL)
    camera = bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('latest', 1))
    assert isinstance(node, FlowFeaturesNode)
    for pixels in (PATTERN, PATTERN, PRESSED):
        if pixels is PRESSED:
            node._capture_again()
        camera.publish(image(pixels))
        run(node)
    message = features_of(born, PRESSED)
    assert message.reference_id == content_id(PRESSED)
    assert np.abs(message.values).max() == pytest.approx(0.0, abs=0.1)
    assert 'only the rest image was restored' in ''.join(capsys.readouterr())


def test_the_force_estimator_comes_back_with_the_model_that_took_over(
    launch: Path, born: Born, small_model: Path, tmp_path: Path
) -> None:
    other = shutil.copy(small_model, tmp_path / 'other.safetensors')
    node, _ = born(ForceEstimatorNode, f'model:={small_model}')
    node._parameters.change({'model': str(other)})
    run(node)
    again, _ = born(ForceEstimatorNode, f'model:={small_model}')
    assert again.params.model == str(other)
    assert again._estimating.now.file == other


def test_a_parameter_that_was_set_is_still_set_and_the_others_are_those_of_the_launch(
    launch: Path, born: Born, small_model: Path
) -> None:
    node, _ = born(ForceEstimatorNode, f'model:={small_model}')
    node._parameters.change({'least_confidence': 0.5})
    run(node)
    again, _ = born(ForceEstimatorNode, f'model:={small_model}', 'frame_id:=skin')
    assert (again.params.least_confidence, again.params.frame_id) == (0.5, 'skin')


def test_kept_parameters_that_are_damaged_count_for_nothing(launch: Path, born: Born, small_model: Path) -> None:
    launch.mkdir()
    (launch / 'force_estimator.parameters').write_bytes(b'{"least_conf')
    node, _ = born(ForceEstimatorNode, f'model:={small_model}', 'least_confidence:=0.6')
    assert node.params.least_confidence == 0.6


def test_a_recorder_that_was_killed_goes_on_in_another_bag_and_leaves_the_first_as_it_was(
    launch: Path, born: Born, tmp_path: Path
) -> None:
    nodes = []
    # What a recording begins with may not come again: the first had it.
    for text, begins_with in (('before', '/chatter'), ('after', '/pictures')):
        words = 'topics:=[/chatter]', 'autostart:=false', f'begins_with:={begins_with}'
        node, bus = born(RecorderNode, f'bag:={tmp_path}/bag', *words)
        talker = bus.advertise('/chatter', 'std_msgs/msg/String', Qos('queue', 10))
        if text == 'before':
            node.start_recording()
        node._look()
        talker.publish(types.String(data=text))
        run(node)
        nodes.append(node)
    for node in nodes:  # the killed one, too, so that its thread does not outlive the test
        node.writer.close()
    for folder, text in ((tmp_path / 'bag', 'before'), (tmp_path / 'bag_2', 'after')):
        with BagReader(folder) as bag:
            assert [bag.decode(message).data for message in bag.messages()] == [text]


@pytest.mark.parametrize('calls', [['stop'], ['stop', 'start', 'stop'], ['stop', 'start']])
@pytest.mark.parametrize('autostart', ['true', 'false'])
def test_a_recording_goes_on_after_a_restart_unless_it_was_stopped_by_its_service(
    launch: Path, born: Born, tmp_path: Path, autostart: str, calls: list[str]
) -> None:
    """The calls of a list arrive while the node is busy, so it answers them one after another."""
    words = f'bag:={tmp_path}/bags/', f'autostart:={autostart}'
    node, bus = born(RecorderNode, *words)
    if autostart == 'false':
        node.start_recording()
    answers: list[Any] = []
    for name in calls:
        bus._services[f'/recorder/{name}'].handler(types.Trigger_Request(), answers.append)
    run(node)
    assert len(answers) == len(calls)
    again, _ = born(RecorderNode, *words)
    for each in (node, again):
        assert (each.writer is not None) is (calls[-1] == 'start')
        if each.writer:  # of the killed one, too, so that its thread does not outlive the test
            each.writer.close()


def test_a_disk_that_has_become_read_only_keeps_no_bag_from_its_end(
    launch: Path, born: Born, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ext4 does after an error: here that of the logs, where the recording is noted."""
    node, _ = born(RecorderNode, f'bag:={tmp_path}/bag', 'autostart:=false')
    node.start_recording()
    run(node)
    unlink = Path.unlink

    def refused(file: Path, missing_ok: bool = False) -> None:
        if file.parent == launch:
            raise OSError(30, 'Read-only file system', str(file))
        unlink(file, missing_ok)

    monkeypatch.setattr(Path, 'unlink', refused)
    assert node.stop_recording().startswith('wrote ')
    assert 'message_count' in (tmp_path / 'bag/metadata.yaml').read_text()


def test_things_of_two_namespaces_are_kept_apart(launch: Path, clock: SteppedClock, small_model: Path) -> None:
    for space, value in (('/left', '0.1'), ('/right', '0.2')):
        words = ['--ros-args', '-r', f'__ns:={space}', '-p', f'model:={small_model}']
        node = ForceEstimatorNode(InProcessBus(clock), parse_arguments(words), clock)
        node._parameters.change({'least_confidence': float(value)})
        run(node)
    words = ['--ros-args', '-r', '__ns:=/left', '-p', f'model:={small_model}']
    assert ForceEstimatorNode(InProcessBus(clock), parse_arguments(words), clock).params.least_confidence == 0.1


def test_where_the_new_cannot_be_kept_a_restart_does_not_find_the_old(launch: Path) -> None:
    """On a full disk: a rest image from before the camera was moved gives wrong forces."""
    kept = Kept('/flow_features')
    kept.put('rest_image', b'before')
    (launch / '.flow_features.rest_image').mkdir()  # nothing can be written there
    kept.put('rest_image', b'before')  # as a restarted node does: it is there already
    assert kept.get('rest_image') == b'before'
    with pytest.raises(BusError, match='will not be available after a restart'):
        kept.put('rest_image', b'after')
    assert kept.get('rest_image') is None
