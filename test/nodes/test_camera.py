"""Pictures out, with the stamp of their capture, whatever happens to the camera."""

from __future__ import annotations

import os
import platform
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from feeding import PATTERN, START_NS, given
from jumping_clock import JumpingClock
from stream_server import plugged_in

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.runtime import run_until
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, SystemClock, monotonic_s
from tactile_nodes.contact_tables import touch_tables
from tactile_nodes.errors import NOT_AGAIN, AskedToEndError, ConfigurationError, DeviceNotFoundError, ImageError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.nodes.camera import CameraNode

PATIENCE_S = 15.0


@pytest.fixture
def clock() -> SystemClock:
    return SystemClock()


@pytest.fixture
def start(bus: InProcessBus) -> Iterator[Callable[..., CameraNode]]:
    nodes = []

    def make(*parameters: str) -> CameraNode:
        nodes.append(CameraNode(bus, given(*parameters)))
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()


def listen(bus: InProcessBus, topic: Topic) -> Subscription:
    return bus.subscribe('/' + topic.name.lstrip('/'), topic.type_name, Qos('queue', 1000))


def first(subscription: Subscription) -> Received:
    received = subscription.get(PATIENCE_S)
    assert received is not None, f'nothing on {subscription.topic}'
    return received


def health(node: CameraNode) -> tuple[int, str]:
    node._report_health()
    (status,) = (each for each in node.diagnostics.message(0).status if each.name == 'camera: camera')
    return status.level, status.message


def picture_status(node: CameraNode) -> tuple[int, str]:
    """What the node says of its pictures, as soon as it says something."""
    deadline_s = monotonic_s() + PATIENCE_S
    while monotonic_s() < deadline_s:
        for status in node.diagnostics.message(0).status:
            if status.name == 'camera: picture':
                return status.level, status.message
    raise AssertionError('nothing was reported of the pictures')


def test_simulated_camera_gives_cropped_grey_images_and_the_truth_of_each(
    bus: InProcessBus, start: Callable[..., CameraNode]
) -> None:
    images, infos, truths = (listen(bus, topic) for topic in (topics.IMAGE, topics.CAMERA_INFO, topics.TRUE_FORCE))
    start()
    image, info, truth = (first(subscription).message for subscription in (images, infos, truths))
    assert (image.width, image.height, image.encoding) == (440, 440, 'mono8')
    assert (info.width, info.height, info.roi.x_offset, info.roi.y_offset) == (640, 480, 100, 20)
    assert stamp_ns(image.header.stamp) == stamp_ns(info.header.stamp) == stamp_ns(truth.header.stamp)
    assert truth.header.frame_id == 'gel_surface'
    assert truth.total == 0.0  # nothing presses in the first second


@pytest.fixture
def described(tmp_path: Path) -> Path:
    (tmp_path / 'mine.yaml').write_text(
        'image: {width: 64, height: 48, crop: 60, crop_height: 44}\n'
        'camera: {model: pinhole, focal_px: [50.0, 51.0], centre_px: [31.5, 23.5]}\n'
    )
    return tmp_path / 'mine.yaml'


def test_pictures_of_a_described_sensor_are_cut_and_reported_as_it_says(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path, described: Path
) -> None:
    source = tmp_path / 'picture.png'
    cv2.imwrite(str(source), PATTERN[:48, :64])
    images, infos = listen(bus, topics.IMAGE), listen(bus, topics.CAMERA_INFO)
    start(f'source:={source}', f'sensor:={described}')
    image, info = first(images).message, first(infos).message
    assert (image.width, image.height) == (60, 44)
    assert (info.width, info.height, info.roi.x_offset, info.roi.y_offset) == (64, 48, 2, 2)
    assert info.distortion_model == 'plumb_bob'
    assert info.k.tolist() == [50.0, 0.0, 31.5, 0.0, 51.0, 23.5, 0.0, 0.0, 1.0]
    assert info.p.reshape(3, 4)[:, :3].ravel().tolist() == info.k.tolist()


def test_pictures_of_another_size_than_described_are_refused(
    start: Callable[..., CameraNode], tmp_path: Path, described: Path
) -> None:
    """The middle of a picture twice as large shows a quarter of what the description says."""
    source = tmp_path / 'picture.png'
    cv2.imwrite(str(source), PATTERN[:96, :128])
    with pytest.raises(ImageError, match=r'gives pictures of 128x96, but image of .*mine.yaml says 64x48; set the'):
        start(f'source:={source}', f'sensor:={described}')


LIGHT_OUTSIDE = 'light.x:=200', 'light.y:=10', 'light.width:=20', 'light.height:=20'


@pytest.mark.parametrize(
    ('picture', 'parameters', 'side', 'warning'),
    [
        pytest.param(np.tile(PATTERN, (2, 2))[:240], (), 240, 'too small for a crop of 440', id='too small'),
        pytest.param(PATTERN, ('crop:=160', *LIGHT_OUTSIDE), 160, 'outside the image of 160x160', id='no light'),
        pytest.param(np.zeros((440, 440), np.uint8), (), 440, 'black', id='black'),
    ],
)
def test_a_picture_that_is_not_as_it_should_be_is_reported(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path, picture: np.ndarray,
    parameters: tuple[str, ...], side: int, warning: str,
) -> None:  # fmt: skip
    cv2.imwrite(str(tmp_path / '0.png'), picture)
    images = listen(bus, topics.IMAGE)
    level, text = picture_status(start(f'source:={tmp_path}', *parameters))
    assert level == Level.WARN
    assert warning in text
    assert first(images).message.width == side


def test_camera_that_is_not_there_is_one_sentence(start: Callable[..., CameraNode]) -> None:
    with pytest.raises(DeviceNotFoundError, match='/dev/video97'):
        start('source:=/dev/video97')


def test_a_second_camera_of_the_same_topic_is_refused(bus: InProcessBus, start: Callable[..., CameraNode]) -> None:
    bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/other_camera')
    publisher = f'/other_camera, process {os.getpid()} on {re.escape(platform.node())}'  # it may be a joined machine's
    refusal = f'^/image_raw is already published by {publisher}: stop that node first, or give'
    with pytest.raises(ConfigurationError, match=refusal):
        start()


def test_a_camera_that_has_ended_is_in_nobodys_way(bus: InProcessBus, start: Callable[..., CameraNode]) -> None:
    bus.advertise('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/other_camera').close()
    assert start().params.source == 'simulated'


@pytest.mark.parametrize('waits', ['wait_s:=10.0', 'open_within_s:=60.0'])
def test_camera_that_is_asked_to_end_while_it_waits_waits_no_longer(
    bus: InProcessBus, tmp_path: Path, waits: str
) -> None:
    arguments = given(waits, f'source:={tmp_path}/none')
    arguments.ending.set()
    with pytest.raises(AskedToEndError):
        CameraNode(bus, arguments)


def test_a_ring_touches_the_simulated_gel_where_it_is_asked_for(
    bus: InProcessBus, start: Callable[..., CameraNode]
) -> None:
    truths, images = listen(bus, topics.TRUE_FORCE), listen(bus, topics.IMAGE)
    start('scene.contact:=ring', 'scene.start_ns:=1', 'fps:=5.0')
    pressed = [first(truths).message for _ in range(10)]  # each visit lasts 2 s
    most = max(pressed, key=lambda each: each.total)
    assert most.total == pytest.approx(2.0, rel=0.3)
    assert np.count_nonzero(np.asarray(most.normal_force) > 0.02) >= 4
    assert first(images).message.height == 440


@pytest.mark.parametrize(
    ('contact', 'reason'),
    [
        ('rign', "^there is no contact 'rign'; give one of: tip, ball, .*, a file: "),
        ('missing.stl', r'^cannot read the body missing.stl \(No such file or directory\); check the path$'),
    ],
)
def test_a_contact_that_is_none_is_one_sentence(start: Callable[..., CameraNode], contact: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        start(f'scene.contact:={contact}')


def test_a_contact_that_is_solved_says_how_far_it_is_and_may_be_given_up(
    bus: InProcessBus, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(touch_tables, 'CELLS', 48)
    monkeypatch.setattr(touch_tables, 'CELL_MM', 0.8)
    logged = listen(bus, topics.ROSOUT)
    arguments = given('scene.contact:=ball')
    arguments.ending.set()
    with pytest.raises(AskedToEndError):
        CameraNode(bus, arguments)
    assert first(logged).message.msg == 'solving the gel deformation under ball (only once): 1 of 7 stages'


def test_diagnostics_name_the_device(start: Callable[..., CameraNode], tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / '0.png'), PATTERN)
    node = start(f'source:={tmp_path}')
    picture_status(node)
    node._report_health()
    assert {each.hardware_id for each in node.diagnostics.message(0).status} == {str(tmp_path)}


def test_camera_that_comes_a_little_later_is_waited_for(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path
) -> None:
    images, source = listen(bus, topics.IMAGE), tmp_path / 'frames'

    class Later(SystemClock):
        def sleep_until(self, at_ns: int) -> None:
            source.mkdir(exist_ok=True)  # while the node waits
            cv2.imwrite(str(source / '1.png'), PATTERN)

    words = given(f'source:={source}', 'crop:=160', 'open_within_s:=30.0')
    node = CameraNode(bus, words, Later())
    assert first(images).message.width == 160
    node.close()


def test_simulated_time_stamps_no_images_and_holds_up_no_camera(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path
) -> None:
    """A file of parameters may set it for all nodes, also before anything publishes /clock."""
    for number in range(3):
        cv2.imwrite(str(tmp_path / f'{number}.png'), PATTERN)
    images, begun_ns = listen(bus, topics.IMAGE), bus.clock.now_ns()
    start('use_sim_time:=true', f'source:={tmp_path}', 'wait_for:=flow_features', 'wait_s:=0.1', 'crop:=160')
    stamps_ns = [stamp_ns(first(images).message.header.stamp) for _ in range(3)]
    assert begun_ns <= stamps_ns[0] < stamps_ns[1] < stamps_ns[2] <= bus.clock.now_ns()


def test_picture_of_another_size_than_asked_names_both(start: Callable[..., CameraNode], tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / '0.png'), PATTERN)
    with pytest.raises(ImageError, match=r'160x160.*640x480'):
        start(f'source:={tmp_path}', 'width:=640', 'height:=480')


def test_a_folder_of_pictures_of_two_sizes_is_not_played_again(
    start: Callable[..., CameraNode], tmp_path: Path
) -> None:
    """A launch would start it again for ever, and play the first pictures each time."""
    for number, side in enumerate((100, 50)):
        cv2.imwrite(str(tmp_path / f'{number}.png'), np.full((side, side), number * 100, np.uint8))
    node = start(f'source:={tmp_path}', 'fps:=100.0')
    assert run_until([node], threading.Event()) == NOT_AGAIN
    assert 'put each size into its own folder' in str(node.failure)


def test_camera_that_is_unplugged_is_reported_and_comes_back_by_itself(
    bus: InProcessBus, start: Callable[..., CameraNode]
) -> None:
    images = listen(bus, topics.IMAGE)
    with plugged_in(PATTERN) as address:
        node = start(f'source:={address}', 'crop:=160')
        before = stamp_ns(first(images).message.header.stamp)
        assert health(node)[0] == Level.OK
    deadline_s = monotonic_s() + PATIENCE_S
    while health(node)[0] != Level.ERROR and monotonic_s() < deadline_s:
        images.get(0.05)
    level, text = health(node)
    assert level == Level.ERROR
    assert 'reconnecting' in text
    while images.take() is not None:
        pass
    with plugged_in(PATTERN, int(address.split(':')[2].split('/')[0])):
        after = stamp_ns(first(images).message.header.stamp)
        assert after > before
        assert health(node)[0] == Level.OK
        assert 'reconnected' in health(node)[1]


def test_a_camera_that_is_closed_while_a_frame_is_on_its_way_ends_quietly(
    bus: InProcessBus, start: Callable[..., CameraNode]
) -> None:
    """On a machine without time to spare closing does not wait for the reader; what it still reads reaches nobody."""
    made: list[CameraNode] = []

    def close() -> None:
        if made:
            made[0]._closing.set()
            made[0]._camera.close()

    bus.subscribe('/image_raw', topics.IMAGE.type_name, Qos('queue', 1000), '', close)
    made.append(start('source:=simulated'))
    made[0]._reader.join(PATIENCE_S)
    assert not made[0]._reader.is_alive()


def test_a_source_waits_for_the_node_that_it_is_reported_to_wait_for(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / '1.png'), PATTERN)
    somebody = bus.subscribe('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/live_view', lambda: None)
    waited: list[bool] = []

    class Later(SystemClock):
        def sleep_until(self, at_ns: int) -> None:
            if not waited:
                bus.subscribe('/image_raw', topics.IMAGE.type_name, topics.IMAGE.qos, '/flow_features', lambda: None)
            waited.append(True)

    words = given(f'source:={tmp_path}', 'wait_for:=flow_features', 'wait_s:=10.0')
    CameraNode(bus, words, Later()).close()
    assert waited
    somebody.close()


def test_a_source_waits_longer_where_nodes_start_late(
    bus: InProcessBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With four programs a processor for 40 s instead of 10 s."""
    cv2.imwrite(str(tmp_path / '1.png'), PATTERN)
    monkeypatch.setattr(os, 'getloadavg', lambda: (4.0 * len(os.sched_getaffinity(0)), 0.0, 0.0))
    listeners: list[Subscription] = []

    class Later(JumpingClock):
        def sleep_until(self, deadline_ns: int) -> None:
            super().sleep_until(deadline_ns)
            if not listeners and self.now_ns() >= START_NS + 39 * NS_PER_S:
                listeners.append(bus.subscribe('/image_raw', topics.IMAGE.type_name, Qos('queue', 9), '/flow_features'))

    logs = listen(bus, topics.ROSOUT)
    words = given(f'source:={tmp_path}', 'wait_for:=flow_features', 'wait_s:=10.0')
    CameraNode(bus, words, Later(START_NS)).close()
    assert listeners
    while (received := logs.take()) is not None:
        assert 'did not subscribe' not in received.message.msg


def test_a_source_that_starts_without_the_node_that_it_waited_for_is_reported(
    bus: InProcessBus, start: Callable[..., CameraNode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node misses the first pictures, so that another than that of the untouched gel becomes its rest image."""
    monkeypatch.setattr(os, 'getloadavg', lambda: (0.0, 0.0, 0.0))
    cv2.imwrite(str(tmp_path / '1.png'), PATTERN)
    logs = listen(bus, topics.ROSOUT)
    start(f'source:={tmp_path}', 'wait_for:=flow_features', 'wait_s:=0.1', 'crop:=160')
    assert first(logs).message.msg.startswith('flow_features did not subscribe to /image_raw within 0.1 s')
