"""Images in, features out: stamps, rest images, faults."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from feeding import PATTERN, START_NS, image, run

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import services, stamp_ns, types
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.sensing.rest.reference import content_id

Listen = Callable[[Topic], Subscription]
FORCE = types.ForceDistribution
Advertise = Callable[[Topic], Publisher]
SMALL: list[str] = []


@pytest.fixture(autouse=True)
def _small(patches_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], 'SMALL', [f'model:={patches_model}', 'reference_frames:=1'])


def node(bus: InProcessBus, clock: SteppedClock, *parameters: str) -> FlowFeaturesNode:
    words = [word for each in (*SMALL, *parameters) for word in ('-p', each)]
    return FlowFeaturesNode(bus, parse_arguments(['--ros-args', *words]), clock)


def measured(features: Subscription) -> list[types.FlowFeatures]:
    """What came, but for frames of which nothing could be measured."""
    found = []
    while (received := features.take()) is not None:
        if not received.message.reasons & (FORCE.REASON_NO_REFERENCE | FORCE.REASON_OTHER_IMAGE):
            found.append(received.message)
    return found


def test_features_carry_the_stamp_of_their_image(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE)
    tested = node(bus, clock, 'registration.check:=false')
    camera.publish(image(PATTERN))
    run(tested)
    camera.publish(image(np.roll(PATTERN, 2, axis=1), START_NS + 7))
    run(tested)
    (message,) = measured(features)  # the first frame became the rest image
    assert stamp_ns(message.header.stamp) == START_NS + 7
    assert (message.rows, message.cols, message.channels, message.image_width) == (4, 4, 2, 160)
    # The picture went 2 px to the right; DIS reads whole motions of this size to a tenth.
    assert np.median(message.values.reshape(4, 4, 2)[..., 0]) == pytest.approx(2.0, abs=0.1)
    assert len(message.reference_id) == 12


@pytest.mark.parametrize(('hz', 'step'), [(600, 10), (120, 2), (60, 1), (70, 1)])
def test_of_a_faster_camera_the_first_picture_of_each_frame_interval_is_answered(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, hz: int, step: int
) -> None:
    """Also in a replay that begins with another picture. Of a camera that is hardly faster, all are answered."""
    features, camera = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE)
    stamps = [START_NS + 10**6 + number * 10**9 // hz for number in range(41)]
    for begin in (0, 1):
        tested, answered = node(bus, clock, 'most_hz:=60.0'), []
        for each in stamps[begin:]:
            camera.publish(image(PATTERN, each))
            run(tested)
            while (received := features.take()) is not None:
                answered.append(stamp_ns(received.message.header.stamp))
        assert answered[0] == stamps[begin]
        assert answered[1:] == [each for each in stamps[::step] if each > stamps[begin]]
        tested.close()


def test_a_camera_from_which_no_picture_comes_any_more_is_reported_and_when_it_is_back(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise
) -> None:
    """Its process hangs, say, and reports nothing itself. One that brings a picture every five seconds does not."""
    camera, tested = publisher(topics.IMAGE), node(bus, clock)

    def status(after_s: float, *, comes: bool = False) -> tuple[Level, str]:
        clock.advance(after_s)
        if comes:
            camera.publish(image(PATTERN, clock.now_ns()))
        run(tested)
        tested._check_pictures()  # as each second
        found = next(each for each in tested.diagnostics.message(0).status if each.name.endswith('pictures'))
        return Level(found.level), found.message

    assert status(0.0, comes=True)[0] is Level.OK
    assert status(0.1, comes=True)[0] is Level.OK
    assert status(1.5)[0] is Level.OK
    assert status(1.0) == (Level.WARN, 'no more pictures; check the camera and its node')
    assert status(1.0, comes=True)[0] is Level.OK
    assert status(5.0, comes=True)[0] is Level.OK
    assert status(10.0)[0] is Level.OK
    assert status(6.0)[0] is Level.WARN


WHOLE = np.random.default_rng(6).integers(20, 200, (480, 640), dtype=np.uint8)


@pytest.mark.parametrize(('crop', 'side'), [(0, 160), (400, 400)])  # 0: that of the model
def test_of_a_whole_picture_of_another_camera_node_the_middle_is_measured_and_that_is_reported_once(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, crop: int, side: int
) -> None:
    features, references, logs = listen(topics.FLOW_FEATURES), listen(topics.REFERENCE_IMAGE), listen(topics.ROSOUT)
    camera, tested = publisher(topics.IMAGE), node(bus, clock, f'crop:={crop}')
    coloured = np.repeat(WHOLE[..., None], 3, axis=2).tobytes()
    for number in range(3):
        head = conversions.header(START_NS + number, 'usb_cam')
        data = np.frombuffer(coloured, np.uint8)
        camera.publish(types.Image(header=head, width=640, height=480, encoding='rgb8', step=1920, data=data))
        run(tested)
    assert {(each.image_width, each.image_height) for each in measured(features)} == {(side, side)}
    received = references.take()
    assert received is not None
    rows, columns = slice(240 - side // 2, 240 + side // 2), slice(320 - side // 2, 320 + side // 2)
    np.testing.assert_array_equal(conversions.image_array(received.message), WHOLE[rows, columns])
    lines = [line for line in logged(logs) if 'image_raw' in line]
    assert lines == [f'/image_raw has 640x480 rgb8: the central {side}x{side} are used (parameter crop)']


def test_pictures_that_our_camera_node_has_cut_are_measured_whole(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    logs, camera, tested = listen(topics.ROSOUT), publisher(topics.IMAGE), node(bus, clock)
    camera.publish(image(WHOLE[:, :480]))
    run(tested)
    assert '/image_raw has 480x480 mono8: used whole' in logged(logs)


@pytest.mark.parametrize(
    ('size', 'taken', 'told'),
    [
        ((160, 200), (160, 120), 'the central 120x160 are used (parameter sensor)'),
        ((160, 120), (160, 120), 'used whole'),
        ((320, 400), (320, 400), 'used whole, but sensor {} is described with 200x160; set the camera so'),
        ((200, 200), (200, 200), 'used whole, but sensor {} is described with 200x160; set the camera so'),
    ],
)
def test_with_a_description_only_pictures_of_its_size_are_cropped(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, tmp_path: Path,
    size: tuple[int, int], taken: tuple[int, int], told: str,
) -> None:  # fmt: skip
    """The middle of a picture of another size would show another part of the gel, and give wrong forces."""
    described = tmp_path / 'mine.yaml'
    described.write_text(
        'image: {width: 200, height: 160, crop: 120, crop_height: 160}\ncamera: {centre_px: [99.5, 79.5]}\n'
    )
    references, logs, camera = listen(topics.REFERENCE_IMAGE), listen(topics.ROSOUT), publisher(topics.IMAGE)
    tested = node(bus, clock, f'sensor:={described}')
    camera.publish(image(WHOLE[: size[0], : size[1]]))
    run(tested)
    received = references.take()
    assert received is not None
    assert (received.message.height, received.message.width) == taken
    height, width = size
    assert f'/image_raw has {width}x{height} mono8: {told.format(described)}' in logged(logs)


def logged(logs: Subscription) -> list[str]:
    """The lines of the log that came since."""
    found = []
    while (received := logs.take()) is not None:
        found.append(received.message.msg)
    return found


def test_a_knocked_camera_is_no_motion_and_is_reported(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera, tested = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE), node(bus, clock)
    for number, pixels in enumerate((PATTERN, *[np.roll(PATTERN, 2, axis=1)] * 4)):
        camera.publish(image(pixels, START_NS + number))
        run(tested)
    first, *_, message = measured(features)
    assert message.moved == pytest.approx(2.0, abs=0.05)
    assert message.picture_motion[:2] == pytest.approx([2.0, 0.0], abs=0.05)
    assert np.abs(np.median(message.values.reshape(4, 4, 2), axis=(0, 1))).max() < 0.05
    # All of it moves alike in frame after frame, so nothing touches.
    assert (first.reasons, message.reasons) == (FORCE.REASON_FOREIGN_MOTION, 0)


def test_frames_before_there_is_a_rest_image_say_so(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera, tested = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE), node(bus, clock)
    camera.publish(image(PATTERN))
    run(tested)
    received = features.take()
    assert received is not None
    assert received.message.reasons == FORCE.REASON_NO_REFERENCE
    assert not received.message.confidence.any()


def test_rest_image_is_announced_to_those_who_come_later(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    camera, tested = publisher(topics.IMAGE), node(bus, clock)
    camera.publish(image(PATTERN))
    run(tested)
    received = listen(topics.REFERENCE_IMAGE).take()
    assert received is not None
    assert (received.message.data == PATTERN.reshape(-1)).all()


def test_dark_frames_at_the_start_do_not_become_the_rest_image(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    reference, camera, tested = listen(topics.REFERENCE_IMAGE), publisher(topics.IMAGE), node(bus, clock)
    for _ in range(3):
        camera.publish(image(np.zeros_like(PATTERN)))
        run(tested)
    assert reference.take() is None
    (status,) = (each for each in tested.diagnostics.message(0).status if each.name == 'flow_features: rest image')
    assert 'black' in status.message
    camera.publish(image(PATTERN))
    run(tested)
    assert reference.take() is not None


def test_a_rest_image_of_a_picture_that_never_rests_is_reported_with_what_to_do(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise
) -> None:
    camera, tested = publisher(topics.IMAGE), node(bus, clock, 'reference_frames:=2')
    for number in range(9):  # four times two frames, and one
        camera.publish(image(np.roll(PATTERN, number % 2, axis=1)))
        run(tested)
    (status,) = (each for each in tested.diagnostics.message(0).status if each.name == 'flow_features: rest image')
    assert status.level == Level.WARN
    assert 'but the picture never was still: do not touch the gel, then call capture_reference' in status.message


def test_rest_image_is_captured_again_on_request(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    reference, camera, tested = listen(topics.REFERENCE_IMAGE), publisher(topics.IMAGE), node(bus, clock)
    camera.publish(image(PATTERN))
    run(tested)
    tested._capture_again()
    camera.publish(image(PATTERN[::-1].copy()))
    run(tested)
    first, second = reference.take(), reference.take()
    assert first is not None
    assert second is not None
    assert (second.message.data == PATTERN[::-1].reshape(-1)).all()


def test_rest_image_comes_from_a_file(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, tmp_path: Path
) -> None:
    file = tmp_path / 'rest.png'
    cv2.imwrite(str(file), PATTERN)
    features, camera = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE)
    tested = node(bus, clock, 'reference:=file', f'reference_file:={file}')
    camera.publish(image(PATTERN))
    run(tested)
    assert features.take() is not None


def test_rest_image_from_a_file_is_cropped_as_pictures_are(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise, tmp_path: Path
) -> None:
    whole, file = np.pad(PATTERN, ((20, 20), (100, 100)), mode='reflect'), tmp_path / 'rest.png'
    cv2.imwrite(str(file), whole)
    reference = listen(topics.REFERENCE_IMAGE)
    tested = node(bus, clock, 'reference:=file', f'reference_file:={file}', f'crop:={PATTERN.shape[0]}')
    run(tested)
    received = reference.take()
    assert received is not None
    assert (conversions.image_array(received.message) == PATTERN).all()


@pytest.mark.parametrize('content', [None, b'no picture'])
def test_rest_image_file_that_is_none_is_one_sentence(
    bus: InProcessBus, clock: SteppedClock, tmp_path: Path, content: bytes | None
) -> None:
    file = tmp_path / 'rest.png'
    if content:
        file.write_bytes(content)
    with pytest.raises(ConfigurationError, match='cannot read the picture'):
        node(bus, clock, 'reference:=file', f'reference_file:={file}')


def test_rest_image_comes_from_a_topic_and_images_before_it_wait_for_nothing(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera, reference = (
        listen(topics.FLOW_FEATURES),
        publisher(topics.IMAGE),
        publisher(topics.REFERENCE_IMAGE),
    )
    tested = node(bus, clock, 'reference:=topic')
    camera.publish(image(PATTERN))
    run(tested)
    assert not measured(features)
    reference.publish(image(PATTERN))
    run(tested)
    camera.publish(image(PATTERN, START_NS + 1))
    run(tested)
    assert len(measured(features)) == 1


def test_image_of_another_size_is_reported_and_does_not_end_the_node(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera, tested = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE), node(bus, clock)
    camera.publish(image(PATTERN))
    run(tested)
    features.take()
    camera.publish(image(PATTERN[:120, :120].copy(), START_NS + 1))
    run(tested)
    received = features.take()
    assert received is not None
    assert received.message.reasons == FORCE.REASON_OTHER_IMAGE
    assert any('120x120' in status.message for status in tested.diagnostics.message(0).status)
    camera.publish(image(PATTERN))
    run(tested)
    assert features.take() is not None
    (rest,) = (each for each in tested.diagnostics.message(0).status if each.name == 'flow_features: rest image')
    assert (rest.level, '160x160' in rest.message) == (Level.OK, True)  # pictures are of the right size again


def test_dark_image_is_marked(bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise) -> None:
    features, camera, tested = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE), node(bus, clock)
    for number, pixels in enumerate((PATTERN, np.zeros_like(PATTERN))):
        camera.publish(image(pixels, START_NS + number))
        run(tested)
    (message,) = measured(features)
    assert message.reasons == FORCE.REASON_DARK_IMAGE
    assert message.image_level == 0.0


def test_a_frame_like_the_rest_image_is_reported_as_untouched_and_one_that_moved_is_not(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE)
    tested = node(bus, clock, 'stillness.full_every:=1000000', 'registration.check:=false')
    for pixels in (PATTERN, PATTERN, np.roll(PATTERN, 2, axis=1)):
        camera.publish(image(pixels))
        run(tested)
    found = [(message.untouched, bool(message.values.any())) for message in measured(features)]
    assert found == [(True, False), (False, True)]


def test_every_frame_is_measured_when_the_check_is_off(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera = listen(topics.FLOW_FEATURES), publisher(topics.IMAGE)
    tested = node(bus, clock, 'stillness.check:=false')
    for pixels in (PATTERN, PATTERN):
        camera.publish(image(pixels))
        run(tested)
    (message,) = measured(features)
    assert not message.untouched


def test_overlay_is_saved_on_request(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, tmp_path: Path
) -> None:
    camera, tested = publisher(topics.IMAGE), node(bus, clock, f'overlay_folder:={tmp_path}')
    for pixels in (PATTERN, np.roll(PATTERN, 3, axis=0)):
        camera.publish(image(pixels))
        run(tested)
    answer = types.Trigger_Response()

    def keep(response: types.Trigger_Response) -> None:
        nonlocal answer
        answer = response

    bus._services['/flow_features/save_overlay'].handler(types.Trigger_Request(), keep)
    run(tested)
    assert answer.success
    assert cv2.imread(str(tmp_path / 'flow_features_000001.png')).shape == (160, 160, 3)
    assert bus._services['/flow_features/save_overlay'].type_name == services.TRIGGER


def test_rest_images_of_two_sensors_are_saved_to_files_of_their_own(
    bus: InProcessBus, clock: SteppedClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, words = tmp_path / 'work', [word for each in SMALL for word in ('-p', each)]
    folder.mkdir()
    monkeypatch.chdir(folder)
    for sensor in ('left', 'right'):
        camera = bus.advertise(f'/{sensor}/{topics.IMAGE.name.lstrip("/")}', topics.IMAGE.type_name, topics.IMAGE.qos)
        tested = FlowFeaturesNode(bus, parse_arguments(['--ros-args', '-r', f'__ns:=/{sensor}', *words]), clock)
        camera.publish(image(PATTERN))
        run(tested)
        handler = bus._services[f'/{sensor}/flow_features/save_reference'].handler
        handler(types.Trigger_Request(), lambda response: None)
        run(tested)
    names = sorted(each.name for each in folder.iterdir())
    assert names == ['left.flow_features_reference.png', 'right.flow_features_reference.png']


def test_a_restarted_node_draws_over_no_earlier_picture(
    bus: InProcessBus, clock: SteppedClock, publisher: Advertise, tmp_path: Path
) -> None:
    camera = publisher(topics.IMAGE)
    for _ in range(2):  # frames 1 and 3 of each start are drawn
        tested = node(bus, clock, f'overlay_folder:={tmp_path / "drawn"}', 'overlay_every:=2')
        for number in range(4):  # the first becomes the rest image
            camera.publish(image(np.roll(PATTERN, number, axis=0)))
            run(tested)
        tested.close()
    drawn = sorted(each.name for each in (tmp_path / 'drawn').iterdir())
    assert drawn == [f'flow_features_00000{number}.png' for number in (1, 3, 4, 6)]


def test_the_nodes_of_two_sensors_draw_over_no_picture_of_each_other(
    bus: InProcessBus, clock: SteppedClock, tmp_path: Path
) -> None:
    """In turns, so that each finds pictures of the other when it begins, and draws while the other does."""
    words = [
        word for each in (*SMALL, f'overlay_folder:={tmp_path / "drawn"}', 'overlay_every:=1') for word in ('-p', each)
    ]
    fingers = [
        FlowFeaturesNode(bus, parse_arguments(['--ros-args', *words, '-r', f'__ns:=/{name}']), clock)
        for name in ('left', 'right')
    ]
    cameras = [
        bus.advertise(f'/{name}/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos) for name in ('left', 'right')
    ]
    for number in range(3):  # the first becomes the rest image
        for tested, camera in zip(fingers, cameras, strict=True):
            camera.publish(image(np.roll(PATTERN, number, axis=0)))
            run(tested)
    drawn = sorted(each.name for each in (tmp_path / 'drawn').iterdir())
    assert drawn == [f'{name}.flow_features_00000{number}.png' for name in ('left', 'right') for number in (1, 2)]


def test_a_rest_image_from_the_topic_is_not_used_for_pictures_that_were_captured_before_it(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    """In a replay on a busy machine, pictures wait in a queue, and a rest image does not wait behind them."""
    features, camera, reference = (
        listen(topics.FLOW_FEATURES),
        publisher(topics.IMAGE),
        publisher(topics.REFERENCE_IMAGE),
    )
    tested, first, second = node(bus, clock, 'reference:=topic'), PATTERN, PATTERN[::-1].copy()
    for pixels, captured_ns in ((first, START_NS), (second, START_NS + 2)):
        reference.publish(image(pixels, captured_ns))
        run(tested)
    used = []
    for after_ns, pixels in ((1, first), (2, first), (3, second), (4, second)):
        camera.publish(image(pixels, START_NS + after_ns))
        run(tested)
        used += [message.reference_id for message in measured(features)]
    assert used == 2 * [content_id(first)] + 2 * [content_id(second)]


def test_a_rest_image_with_a_stamp_of_another_time_base_is_used_a_second_after_it_has_come(
    bus: InProcessBus, clock: SteppedClock, listen: Listen, publisher: Advertise
) -> None:
    features, camera, reference = (
        listen(topics.FLOW_FEATURES),
        publisher(topics.IMAGE),
        publisher(topics.REFERENCE_IMAGE),
    )
    tested = node(bus, clock, 'reference:=topic')
    reference.publish(image(PATTERN, START_NS + 10**15))
    for _ in range(2):
        clock.advance(0.6)
        camera.publish(image(PATTERN, clock.now_ns()))
        run(tested)
    (only,) = measured(features)
    assert stamp_ns(only.header.stamp) == START_NS + 1_200_000_000
