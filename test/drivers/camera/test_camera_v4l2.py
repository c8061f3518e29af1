"""A V4L2 camera, against an emulation of what such devices were seen to do. No device is replaced by it: the
contract test runs on a real one with ``-m hardware``."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import os
import re
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

from tactile_nodes.clock import SystemClock, from_monotonic_ns
from tactile_nodes.drivers.camera.contract import CameraSettings, Frame
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.camera.reader import LiveCamera
from tactile_nodes.drivers.camera.v4l2 import PAUSE_S, V4l2Connection, fourcc_text
from tactile_nodes.drivers.camera.v4l2_controls import KernelControls, apply
from tactile_nodes.drivers.camera.v4l2_devices import check_device
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceNotFoundError, DeviceTimeoutError
from tactile_nodes.params import from_mapping, load_parameter_file


@pytest.fixture
def start(device, clock: SystemClock) -> Iterator[object]:
    """Opens the emulated device with settings of the test's own."""
    with contextlib.ExitStack() as stack:

        def opened(**settings: object) -> LiveCamera:
            requested = CameraSettings(str(device.node), **{'fps': 100.0, **settings})
            camera = live(requested, clock, device)
            stack.callback(camera.close)
            return camera

        yield opened


def live(settings: CameraSettings, clock: SystemClock, device, check=lambda path: None) -> LiveCamera:
    def connect() -> V4l2Connection:
        return V4l2Connection(settings, clock, device.capture, device.access, check)

    camera = LiveCamera(str(device.node), connect, clock, settings)
    camera.open()
    return camera


def until_lost(camera: LiveCamera) -> str:
    """Why it was lost."""
    while camera.health.level != Level.ERROR:
        with contextlib.suppress(DeviceTimeoutError):
            camera.read(0.05)
    return camera.health.message


def read_past(camera: LiveCamera, seconds: float) -> Frame:
    """The first frame that was taken this much later than the next one."""
    first = frame = camera.read(20.0)
    while frame.stamp_ns - first.stamp_ns < seconds * 1e9:
        frame = camera.read(20.0)
    return frame


def test_the_format_is_set_before_the_size_and_the_size_before_the_rate(device, start) -> None:
    start(width=320, height=240)
    properties = [int(name) for name, _ in device.calls if name.isdigit()]
    assert properties[:4] == [
        cv2.CAP_PROP_FOURCC,
        cv2.CAP_PROP_FRAME_WIDTH,
        cv2.CAP_PROP_FRAME_HEIGHT,
        cv2.CAP_PROP_FPS,
    ]


def test_what_was_asked_and_what_was_got_stand_side_by_side(device, start) -> None:
    device.controls = {'auto_exposure': 3, 'exposure_time_absolute': 50, 'gain': 29}
    camera = start(width=320, height=240, exposure_ms=15.6, gain=10)
    camera.read(20.0)
    description = camera.description
    assert description['format'] == 'MJPG (requested MJPG)'
    assert description['size'] == '320x240 (requested 320x240)'
    assert description['frames/s'] == '100 (requested 100)'
    assert description['auto_exposure'] == '1 (requested 1)'
    assert description['exposure_time_absolute'] == '156 (requested 156)'
    assert description['gain'] == '10 (requested 10)'
    assert description['autogain'] == 'missing'
    assert description['stamps'] == 'kernel, CLOCK_MONOTONIC'
    assert camera.health.level == Level.OK


@pytest.mark.parametrize(
    ('has', 'settings', 'warning'),
    [
        ({'formats': ('YUYV',)}, {}, 'the pixel format is BGR3, but MJPG was requested'),
        ({'rates': (50.0, 25.0)}, {'fps': 60.0}, 'it gives 50 frames/s, but 60 was requested'),
        ({}, {'keep_auto': True, 'gain': 10}, 'gain is 29, but 10 was requested'),
        ({'controls': {}}, {'gain': 10}, 'gain is missing, but 10 was requested'),
    ],
    ids=['format', 'rate', 'a control that lies', 'a missing control'],
)
def test_what_was_not_taken_is_a_warning(device, start, has: dict, settings: dict, warning: str) -> None:
    for name, value in has.items():
        setattr(device, name, value)
    health = start(**settings).health
    assert health.level == Level.WARN
    assert warning in health.message


def test_automatic_modes_are_switched_off_before_the_values_that_they_would_override(device, start) -> None:
    """With auto-gain on, the device keeps its gain of 29 whatever is asked; the value must come after."""
    start(gain=10)
    order = [name for name, _ in device.calls if not name.isdigit()]
    assert order == ['auto_exposure', 'autogain', 'gain']
    assert device.controls == {'auto_exposure': 1, 'autogain': 0, 'gain': 10}


def test_automatic_modes_may_be_left_on(device, start) -> None:
    before = dict(device.controls)
    start(keep_auto=True)
    assert device.controls == before


def test_controls_that_the_camera_forgets_are_set_again_a_second_later(device, start) -> None:
    camera = start()
    camera.read(20.0)
    device.controls['auto_exposure'] = 3
    read_past(camera, 1.1)
    assert device.controls['auto_exposure'] == 1


def arrived(device, stamp_ns: int) -> bool:
    """Whether this is the time at which a frame was handed over, and before its picture was asked for."""
    times = zip(device.handed_ns, device.asked_ns, strict=False)  # it goes on meanwhile
    return any(from_monotonic_ns(handed - 1000) <= stamp_ns <= from_monotonic_ns(asked) for handed, asked in times)


def test_frames_carry_the_stamp_of_the_kernel(device, start) -> None:
    """The emulated device stamps 50 ms before it hands a frame over."""
    device.stamp_offset_ms = -50.0
    camera = start()
    stamp_ns = camera.read(20.0).stamp_ns
    assert stamp_ns in {from_monotonic_ns(round(stamp_ms * 1e6)) for stamp_ms in list(device.stamps_ms)}
    assert camera.health.level == Level.OK


def test_senseless_stamps_give_way_to_arrival_and_say_so(device, start) -> None:
    device.stamp_offset_ms = 3_600_000.0
    camera = start()
    assert arrived(device, camera.read(20.0).stamp_ns)
    ahead = r"arrival \(the driver's stamps are 3(600|59\d)\.\d{3} s in the future\)"  # less by what it was handed late
    assert re.fullmatch(ahead, camera.description['stamps'])
    assert camera.health.level == Level.WARN


def test_a_camera_that_gives_no_stamps_is_stamped_on_arrival(device, start) -> None:
    device.stamp_offset_ms = -time.monotonic() * 1000 - 1e6
    camera = start()
    assert arrived(device, camera.read(20.0).stamp_ns)
    assert camera.description['stamps'] == 'arrival (the driver gives no stamps)'


def test_a_camera_of_which_no_format_is_asked_gives_its_pictures_without_a_warning(device, start) -> None:
    device.formats = ('YUYV',)
    camera = start(fourcc='')
    assert camera.read(20.0).image.shape == (480, 640, 3)
    assert camera.description['format'] == 'YUYV (requested none)'
    assert camera.health.level == Level.OK


def test_a_camera_that_is_slower_than_it_says_is_reported(device, start) -> None:
    """An exposure longer than its period: 40 frames a second, where it announces 100."""
    device.slower = 2.5
    camera = start()
    for _ in range(45):
        camera.read(20.0)
    assert 'frames/s, but announces 100' in camera.health.message


@pytest.mark.parametrize('number', [errno.EACCES, errno.EBUSY, errno.EINVAL, errno.ERANGE, errno.EIO])
def test_a_control_that_the_kernel_refuses_to_change_is_no_error(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It shows in what is read back: auto exposure stays 3 where 1 was asked for."""

    def ioctl(_: int, request: int, data: bytes) -> bytes:
        if request & 0xFF == 28:  # VIDIOC_S_CTRL
            raise OSError(number, os.strerror(number))
        return struct.pack('Ii', struct.unpack('Ii', data)[0], 3)

    node = tmp_path / 'video9'
    node.touch()
    monkeypatch.setattr(fcntl, 'ioctl', ioctl)
    with contextlib.closing(KernelControls(str(node))) as controls:
        (exposure, *_) = apply(controls, CameraSettings(str(node)))
    assert (exposure.name, exposure.got, exposure.requested) == ('auto_exposure', 3, 1)
    assert exposure.complaint


def test_a_late_reader_gets_the_newest_frame_and_the_overtaken_are_counted(device, start) -> None:
    camera = start()
    first = camera.read(20.0)
    enough = device.grabbed + 20
    while device.grabbed < enough:  # a reader that is busy: this is the behaviour under test
        time.sleep(0.01)
    grabbed = device.grabbed
    frame = camera.read(20.0)
    assert frame.sequence - first.sequence > 10
    assert frame.dropped - first.dropped == frame.sequence - first.sequence - 1
    assert frame.sequence + 1 >= grabbed - 1  # the last one may have been under way


def test_pictures_that_are_cut_short_are_dropped_and_counted(device, start) -> None:
    device.spoil = lambda number, data: data[:-40] if number % 2 else data
    camera = start()
    frames = [camera.read(20.0) for _ in range(6)]
    assert all(later.dropped > earlier.dropped for earlier, later in itertools.pairwise(frames))


@pytest.mark.parametrize(
    ('stall_s', 'fault', 'sentence'),
    [
        pytest.param(60.0, lambda device: device.unplug(), 'was unplugged; plug it in again', id='unplugged: at once'),
        pytest.param(
            0.2, lambda device: setattr(device, 'unreadable', True), 'no complete picture',
            id='pictures that OpenCV cannot convert',
        ),
    ],
)  # fmt: skip
def test_a_camera_without_pictures_is_lost_with_a_sentence(device, start, stall_s: float, fault, sentence: str) -> None:
    camera = start(stall_s=stall_s)
    camera.read(20.0)
    fault(device)
    assert sentence in until_lost(camera)


def test_a_camera_that_fails_every_grab_is_lost_after_the_stall_time_without_spinning(device, start) -> None:
    camera = start(stall_s=0.3)
    camera.read(20.0)
    grabs = []
    device.slower = 0.0
    started = time.monotonic()
    device.spoil = lambda number, data: grabs.append(number) or b''
    assert re.search(r'no complete picture for \d\.\d s; check its cable', until_lost(camera))
    passed_s = time.monotonic() - started
    assert passed_s >= 0.3
    assert len(grabs) < 1 + passed_s / (0.8 * PAUSE_S)


def test_a_stalled_camera_times_out_although_the_grab_blocks(device, start) -> None:
    camera = start()
    camera.read(20.0)
    device.stalled.set()
    while not device.blocked:
        time.sleep(0.01)
    with pytest.raises(DeviceTimeoutError):
        while True:
            camera.read(0.1)
    assert device.blocked
    device.stalled.clear()


def test_a_camera_that_is_unplugged_and_plugged_in_again_goes_on(device, clock: SystemClock) -> None:
    settings = CameraSettings(str(device.node), fps=100.0)

    def check(path: str) -> None:
        if not Path(path).exists():
            raise DeviceNotFoundError(f'there is no camera {path}')

    camera = live(settings, clock, device, check)
    camera.read(20.0)
    device.unplug()
    until_lost(camera)
    device.plug()
    deadline = time.monotonic() + 60
    while camera.health.level != Level.OK:
        assert time.monotonic() < deadline
        with contextlib.suppress(DeviceTimeoutError):
            camera.read(0.2)
    camera.close()
    assert device.opened == 2
    device.wait_until_released()


def test_a_missing_camera_is_reported_with_those_that_are_there(tmp_path: Path) -> None:
    (tmp_path / 'usb-Ailipu_ELP-video-index0').touch()
    with pytest.raises(DeviceNotFoundError, match=r'no camera /dev/video63; found: .*usb-Ailipu_ELP-video-index0'):
        check_device('/dev/video63', tmp_path)


def test_a_pixel_format_is_read_from_its_code() -> None:
    """V4L2_PIX_FMT_MJPEG is v4l2_fourcc('M', 'J', 'P', 'G'): least significant character first."""
    assert fourcc_text(0x47504A4D) == 'MJPG'
    assert fourcc_text(-1) == '\xff\xff\xff\xff'


@pytest.mark.hardware
def test_the_real_camera_takes_its_controls() -> None:
    """Auto-exposure off is what keeps the rest image valid."""
    path = os.environ.get('TACTILE_CAMERA', '/dev/video0')
    if not Path(path).exists():
        pytest.skip(f'no camera {path}')
    camera = open_camera(CameraSettings(path, fps=0.0), SystemClock())
    read_past(camera, 1.2)
    assert camera.description['auto_exposure'] in {'1 (requested 1)', 'missing'}
    camera.close()


def test_the_settings_of_the_shipped_camera_are_settings_of_a_camera() -> None:
    (block,) = load_parameter_file(Path(__file__).parents[3] / 'config' / 'camera_elp.yaml')
    settings = from_mapping(CameraSettings, block.values)
    assert (settings.width, settings.height, settings.fps, settings.fourcc) == (640, 480, 60.0, 'MJPG')
    assert not settings.keep_auto
