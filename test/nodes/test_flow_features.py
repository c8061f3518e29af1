"""Images in, features out: stamps, rest images, faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from feeding import PATTERN, START_NS, image, run, taken

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

FORCE = types.ForceDistribution
NO_MEASURE = FORCE.REASON_NO_REFERENCE | FORCE.REASON_OTHER_IMAGE
MOVED = np.roll(PATTERN, 2, axis=1)
TOPIC = 'reference:=topic'


class Bench:
    """The node between its camera and everybody who listens."""

    def __init__(
        self,
        bus: InProcessBus,
        clock: SteppedClock,
        listen: Callable[[Topic], Subscription],
        publisher: Callable[[Topic], Publisher],
        *words: str,
    ) -> None:
        self._features, self._rests, self._logs = (
            listen(topic) for topic in (topics.FLOW_FEATURES, topics.REFERENCE_IMAGE, topics.ROSOUT)
        )
        self._publisher = publisher
        self.camera = publisher(topics.IMAGE)
        self.node = FlowFeaturesNode(bus, parse_arguments(['--ros-args', *words]), clock)

    def show(self, *pictures: np.ndarray, begin_ns: int = START_NS) -> None:
        for number, pixels in enumerate(pictures):
            self.camera.publish(image(pixels, begin_ns + number))
            run(self.node)

    def rest(self, pixels: np.ndarray, stamp_ns: int = START_NS) -> None:
        """Another node tells it the rest image."""
        self._publisher(topics.REFERENCE_IMAGE).publish(image(pixels, stamp_ns))
        run(self.node)

    def features(self) -> list[Any]:
        return taken(self._features)

    def measured(self) -> list[Any]:
        """What came, but for frames of which nothing could be measured."""
        return [each for each in self.features() if not each.reasons & NO_MEASURE]

    def rests(self) -> list[np.ndarray]:
        return [conversions.image_array(each) for each in taken(self._rests)]

    def log(self) -> list[str]:
        return [each.msg for each in taken(self._logs)]

    def status(self, name: str) -> Any:
        (found,) = (each for each in self.node.diagnostics.message(0).status if each.name == f'flow_features: {name}')
        return found


@pytest.fixture
def words(patches_model: Path) -> Callable[..., list[str]]:
    """The words of a program of a small model, which takes one picture as its rest image."""
    given = f'model:={patches_model}', 'reference_frames:=1'
    return lambda *parameters: [word for each in (*given, *parameters) for word in ('-p', each)]


@pytest.fixture
def bench(
    bus: InProcessBus,
    clock: SteppedClock,
    listen: Callable[[Topic], Subscription],
    publisher: Callable[[Topic], Publisher],
    words: Callable[..., list[str]],
) -> Callable[..., Bench]:
    return lambda *parameters: Bench(bus, clock, listen, publisher, *words(*parameters))


@pytest.fixture
def tested(bench: Callable[..., Bench]) -> Bench:
    return bench()


def test_features_carry_the_stamp_of_their_image(bench: Callable[..., Bench]) -> None:
    tested = bench('registration.check:=false')
    tested.show(PATTERN, MOVED)
    (message,) = tested.measured()  # the first frame became the rest image
    assert stamp_ns(message.header.stamp) == START_NS + 1
    assert (message.rows, message.cols, message.channels, message.image_width) == (4, 4, 2, 160)
    # The picture went 2 px to the right; DIS reads whole motions of this size to a tenth.
    assert np.median(message.values.reshape(4, 4, 2)[..., 0]) == pytest.approx(2.0, abs=0.1)
    assert len(message.reference_id) == 12


@pytest.mark.parametrize(('hz', 'step'), [(600, 10), (120, 2), (60, 1), (70, 1)])
def test_of_a_faster_camera_the_first_picture_of_each_frame_interval_is_answered(
    bench: Callable[..., Bench], hz: int, step: int
) -> None:
    """Also in a replay that begins with another picture. Of a camera that is hardly faster, all are answered."""
    stamps = [START_NS + 10**6 + number * 10**9 // hz for number in range(41)]
    for begin in (0, 1):
        tested = bench('most_hz:=60.0')
        for each in stamps[begin:]:
            tested.show(PATTERN, begin_ns=each)
        answered = [stamp_ns(each.header.stamp) for each in tested.features()]
        assert answered[0] == stamps[begin]
        assert answered[1:] == [each for each in stamps[::step] if each > stamps[begin]]
        tested.node.close()


def test_a_camera_from_which_no_picture_comes_any_more_is_reported_and_when_it_is_back(
    tested: Bench, clock: SteppedClock
) -> None:
    """Its process hangs, say, and reports nothing itself. One that brings a picture every five seconds does not."""

    def status(after_s: float, *, comes: bool = False) -> tuple[Level, str]:
        clock.advance(after_s)
        if comes:
            tested.show(PATTERN, begin_ns=clock.now_ns())
        run(tested.node)
        tested.node._check_pictures()  # as each second
        found = tested.status('pictures')
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
    bench: Callable[..., Bench], crop: int, side: int
) -> None:
    tested = bench(f'crop:={crop}')
    data = np.repeat(WHOLE[..., None], 3, axis=2).ravel()
    for number in range(3):
        head = conversions.header(START_NS + number, 'usb_cam')
        tested.camera.publish(types.Image(header=head, width=640, height=480, encoding='rgb8', step=1920, data=data))
        run(tested.node)
    assert {(each.image_width, each.image_height) for each in tested.measured()} == {(side, side)}
    (rest,) = tested.rests()
    rows, columns = slice(240 - side // 2, 240 + side // 2), slice(320 - side // 2, 320 + side // 2)
    np.testing.assert_array_equal(rest, WHOLE[rows, columns])
    lines = [line for line in tested.log() if 'image_raw' in line]
    assert lines == [f'/image_raw has 640x480 rgb8: the central {side}x{side} are used (parameter crop)']


def test_pictures_that_our_camera_node_has_cut_are_measured_whole(tested: Bench) -> None:
    tested.show(WHOLE[:, :480])
    assert '/image_raw has 480x480 mono8: used whole' in tested.log()


@pytest.mark.parametrize(
    ('size', 'used', 'told'),
    [
        ((160, 200), (160, 120), 'the central 120x160 are used (parameter sensor)'),
        ((160, 120), (160, 120), 'used whole'),
        ((320, 400), (320, 400), 'used whole, but sensor {} is described with 200x160; set the camera so'),
        ((200, 200), (200, 200), 'used whole, but sensor {} is described with 200x160; set the camera so'),
    ],
)
def test_with_a_description_only_pictures_of_its_size_are_cropped(
    bench: Callable[..., Bench], tmp_path: Path, size: tuple[int, int], used: tuple[int, int], told: str
) -> None:
    """The middle of a picture of another size would show another part of the gel, and give wrong forces."""
    described = tmp_path / 'mine.yaml'
    described.write_text(
        'image: {width: 200, height: 160, crop: 120, crop_height: 160}\ncamera: {centre_px: [99.5, 79.5]}\n'
    )
    tested = bench(f'sensor:={described}')
    height, width = size
    tested.show(WHOLE[:height, :width])
    assert [rest.shape for rest in tested.rests()] == [used]
    assert f'/image_raw has {width}x{height} mono8: {told.format(described)}' in tested.log()


def test_a_knocked_camera_is_no_motion_and_is_reported(tested: Bench) -> None:
    tested.show(PATTERN, *[MOVED] * 4)
    first, *_, message = tested.measured()
    assert message.moved == pytest.approx(2.0, abs=0.05)
    assert message.picture_motion[:2] == pytest.approx([2.0, 0.0], abs=0.05)
    assert np.abs(np.median(message.values.reshape(4, 4, 2), axis=(0, 1))).max() < 0.05
    # All of it moves alike in frame after frame, so nothing touches.
    assert (first.reasons, message.reasons) == (FORCE.REASON_FOREIGN_MOTION, 0)


def test_frames_before_there_is_a_rest_image_say_so(tested: Bench) -> None:
    tested.show(PATTERN)
    (message,) = tested.features()
    assert message.reasons == FORCE.REASON_NO_REFERENCE
    assert not message.confidence.any()


def test_dark_frames_at_the_start_do_not_become_the_rest_image(tested: Bench) -> None:
    tested.show(*[np.zeros_like(PATTERN)] * 3)
    assert tested.rests() == []
    assert 'black' in tested.status('rest image').message
    tested.show(PATTERN)
    assert len(tested.rests()) == 1


def test_a_rest_image_of_a_picture_that_never_rests_is_reported_with_what_to_do(bench: Callable[..., Bench]) -> None:
    tested = bench('reference_frames:=2')
    tested.show(*[np.roll(PATTERN, number % 2, axis=1) for number in range(9)])  # four times two frames, and one
    status = tested.status('rest image')
    assert status.level == Level.WARN
    assert 'but the picture never was still: do not touch the gel, then call capture_reference' in status.message


def test_a_rest_image_that_is_captured_again_is_announced_also_to_those_who_come_later(
    bench: Callable[..., Bench], listen: Callable[[Topic], Subscription]
) -> None:
    tested, upside_down = bench(), PATTERN[::-1].copy()
    tested.show(PATTERN)
    tested.node._capture_again()
    tested.show(upside_down)
    first, second = tested.rests()
    np.testing.assert_array_equal(first, PATTERN)
    np.testing.assert_array_equal(second, upside_down)
    (latched,) = taken(listen(topics.REFERENCE_IMAGE))
    np.testing.assert_array_equal(conversions.image_array(latched), upside_down)


def test_rest_image_comes_from_a_file_and_is_cropped_as_pictures_are(
    bench: Callable[..., Bench], tmp_path: Path
) -> None:
    whole, file = np.pad(PATTERN, ((20, 20), (100, 100)), mode='reflect'), tmp_path / 'rest.png'
    cv2.imwrite(str(file), whole)
    tested = bench('reference:=file', f'reference_file:={file}', f'crop:={PATTERN.shape[0]}')
    tested.show(PATTERN)
    (rest,) = tested.rests()
    np.testing.assert_array_equal(rest, PATTERN)
    assert len(tested.measured()) == 1


@pytest.mark.parametrize('content', [None, b'no picture'])
def test_rest_image_file_that_is_none_is_one_sentence(
    bench: Callable[..., Bench], tmp_path: Path, content: bytes | None
) -> None:
    file = tmp_path / 'rest.png'
    if content:
        file.write_bytes(content)
    with pytest.raises(ConfigurationError, match='cannot read the picture'):
        bench('reference:=file', f'reference_file:={file}')


def test_a_rest_image_of_another_size_than_the_described_one_is_refused_by_its_name(
    bench: Callable[..., Bench], tmp_path: Path
) -> None:
    cv2.imwrite(str(file := tmp_path / 'turned.png'), np.zeros((320, 240), np.uint8))
    with pytest.raises(
        ConfigurationError, match=r'turned.png has 240x320 pixels, but image of printed_dots says 320x24'
    ):
        bench('reference:=file', f'reference_file:={file}', 'sensor:=printed_dots')


def test_a_file_that_is_not_read_as_the_rest_image_is_named(
    bench: Callable[..., Bench], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(file := tmp_path / 'rest.png'), PATTERN)
    bench(f'reference_file:={file}')
    assert f'{file} is not read, a rest image is captured; add reference:=file' in capfd.readouterr().err


def test_rest_image_comes_from_a_topic_and_images_before_it_wait_for_nothing(bench: Callable[..., Bench]) -> None:
    tested = bench(TOPIC)
    tested.show(PATTERN)
    assert not tested.measured()
    tested.rest(PATTERN)
    tested.show(PATTERN, begin_ns=START_NS + 1)
    assert len(tested.measured()) == 1


def test_image_of_another_size_is_reported_and_does_not_end_the_node(tested: Bench) -> None:
    tested.show(PATTERN, PATTERN[:120, :120].copy())
    assert tested.features()[-1].reasons == FORCE.REASON_OTHER_IMAGE
    assert any('120x120' in status.message for status in tested.node.diagnostics.message(0).status)
    tested.show(PATTERN)
    assert len(tested.measured()) == 1
    rest = tested.status('rest image')
    assert (rest.level, '160x160' in rest.message) == (Level.OK, True)  # pictures are of the right size again


def test_dark_image_is_marked(tested: Bench) -> None:
    tested.show(PATTERN, np.zeros_like(PATTERN))
    (message,) = tested.measured()
    assert message.reasons == FORCE.REASON_DARK_IMAGE
    assert message.image_level == 0.0


@pytest.mark.parametrize(
    ('check', 'found'), [('full_every:=1000000', [(True, False), (False, True)]), ('check:=false', [(False, True)] * 2)]
)
def test_a_frame_like_the_rest_image_is_reported_as_untouched_unless_every_frame_is_measured(
    bench: Callable[..., Bench], check: str, found: list[tuple[bool, bool]]
) -> None:
    tested = bench(f'stillness.{check}', 'registration.check:=false')
    tested.show(PATTERN, PATTERN, MOVED)
    assert [(message.untouched, bool(message.values.any())) for message in tested.measured()] == found


def test_overlay_is_saved_on_request(bench: Callable[..., Bench], bus: InProcessBus, tmp_path: Path) -> None:
    tested, answers = bench(f'overlay_folder:={tmp_path}'), list[Any]()
    tested.show(PATTERN, np.roll(PATTERN, 3, axis=0))
    bus._services['/flow_features/save_overlay'].handler(types.Trigger_Request(), answers.append)
    run(tested.node)
    assert answers[0].success
    assert cv2.imread(str(tmp_path / 'flow_features_000001.png')).shape == (160, 160, 3)
    assert bus._services['/flow_features/save_overlay'].type_name == services.TRIGGER


def test_rest_images_of_two_sensors_are_saved_to_files_of_their_own(
    bus: InProcessBus,
    clock: SteppedClock,
    words: Callable[..., list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (folder := tmp_path / 'work').mkdir()
    monkeypatch.chdir(folder)
    for tested, camera in fingers(bus, clock, words()):
        camera.publish(image(PATTERN))
        run(tested)
        handler = bus._services[f'{tested.full_name}/save_reference'].handler
        handler(types.Trigger_Request(), lambda response: None)
        run(tested)
    names = sorted(each.name for each in folder.iterdir())
    assert names == ['left.flow_features_reference.png', 'right.flow_features_reference.png']


def fingers(bus: InProcessBus, clock: SteppedClock, words: list[str]) -> list[tuple[FlowFeaturesNode, Publisher]]:
    """The nodes of two sensors, and the cameras of both."""
    return [
        (
            FlowFeaturesNode(bus, parse_arguments(['--ros-args', '-r', f'__ns:=/{name}', *words]), clock),
            bus.advertise(f'/{name}/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos),
        )
        for name in ('left', 'right')
    ]


def test_a_restarted_node_draws_over_no_earlier_picture(bench: Callable[..., Bench], tmp_path: Path) -> None:
    for _ in range(2):  # frames 1 and 3 of each start are drawn
        tested = bench(f'overlay_folder:={tmp_path / "drawn"}', 'overlay_every:=2')
        tested.show(*[np.roll(PATTERN, number, axis=0) for number in range(4)])  # the first becomes the rest image
        tested.node.close()
    drawn = sorted(each.name for each in (tmp_path / 'drawn').iterdir())
    assert drawn == [f'flow_features_00000{number}.png' for number in (1, 3, 4, 6)]


def test_the_nodes_of_two_sensors_draw_over_no_picture_of_each_other(
    bus: InProcessBus, clock: SteppedClock, words: Callable[..., list[str]], tmp_path: Path
) -> None:
    """In turns, so that each finds pictures of the other when it begins, and draws while the other does."""
    nodes = fingers(bus, clock, words(f'overlay_folder:={tmp_path / "drawn"}', 'overlay_every:=1'))
    for number in range(3):  # the first becomes the rest image
        for tested, camera in nodes:
            camera.publish(image(np.roll(PATTERN, number, axis=0)))
            run(tested)
    drawn = sorted(each.name for each in (tmp_path / 'drawn').iterdir())
    assert drawn == [f'{name}.flow_features_00000{number}.png' for name in ('left', 'right') for number in (1, 2)]


def test_a_rest_image_from_the_topic_is_not_used_for_pictures_that_were_captured_before_it(
    bench: Callable[..., Bench],
) -> None:
    """In a replay on a busy machine, pictures wait in a queue, and a rest image does not wait behind them."""
    tested, first, second = bench(TOPIC), PATTERN, PATTERN[::-1].copy()
    tested.rest(first, START_NS)
    tested.rest(second, START_NS + 2)
    tested.show(first, first, second, second, begin_ns=START_NS + 1)
    used = [message.reference_id for message in tested.measured()]
    assert used == 2 * [content_id(first)] + 2 * [content_id(second)]


def test_a_rest_image_with_a_stamp_of_another_time_base_is_used_a_second_after_it_has_come(
    bench: Callable[..., Bench], clock: SteppedClock
) -> None:
    tested = bench(TOPIC)
    tested.rest(PATTERN, START_NS + 10**15)
    for _ in range(2):
        clock.advance(0.6)
        tested.show(PATTERN, begin_ns=clock.now_ns())
    (only,) = tested.measured()
    assert stamp_ns(only.header.stamp) == START_NS + 1_200_000_000
