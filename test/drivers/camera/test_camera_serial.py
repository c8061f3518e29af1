"""Cameras by their serial numbers, in a tree as the kernel lays it below /sys/class/video4linux."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tactile_nodes import clock as clocks
from tactile_nodes.cli.camera import sources
from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.camera import v4l2
from tactile_nodes.drivers.camera.contract import CameraSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.camera.reader import LiveCamera
from tactile_nodes.drivers.camera.v4l2 import V4l2Connection
from tactile_nodes.drivers.camera.v4l2_devices import cameras, located
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceNotFoundError, DeviceTimeoutError


def plug_in(sysfs: Path, number: int, port: str, serial: str, index: int = 0) -> None:
    """A node of a UVC camera: `device` leads to the interface, whose folder lies in that of the USB device."""
    usb = sysfs / 'usb' / port
    interface = usb / f'{port}:1.0'
    interface.mkdir(parents=True, exist_ok=True)
    if serial:
        (usb / 'serial').write_text(f'{serial}\n')
    node = sysfs / f'video{number}'
    node.mkdir()
    (node / 'name').write_text('Global Shutter Camera\n')
    (node / 'index').write_text(f'{index}\n')
    (node / 'device').symlink_to(interface)


def test_a_camera_is_found_by_its_serial_number_wherever_it_is_plugged_in(tmp_path: Path) -> None:
    before, after = tmp_path / 'before', tmp_path / 'after'
    for sysfs, first, second in ((before, 0, 2), (after, 2, 0)):
        plug_in(sysfs, first, '1-1', 'A1')
        plug_in(sysfs, first + 1, '1-1', 'A1', index=1)  # the node of its metadata
        plug_in(sysfs, second, '1-2', 'B2')
        plug_in(sysfs, second + 1, '1-2', 'B2', index=1)
    assert located('serial:A1', before) == '/dev/video0'
    assert located('serial:A1', after) == '/dev/video2'
    assert located('/dev/video7', before) == '/dev/video7'


def test_a_serial_number_that_no_camera_has_is_reported_with_those_that_are_there(tmp_path: Path) -> None:
    plug_in(tmp_path, 0, '1-1', 'A1')
    with pytest.raises(DeviceNotFoundError, match=r"serial number 'C3' \(found: A1\)"):
        located('serial:C3', tmp_path)


def test_cameras_with_one_serial_number_are_not_guessed_between(tmp_path: Path) -> None:
    plug_in(tmp_path, 0, '1-1', '01.00.00')
    plug_in(tmp_path, 2, '1-2', '01.00.00')
    with pytest.raises(DeviceNotFoundError, match='/dev/video0 and /dev/video2 have the same serial number'):
        located('serial:01.00.00', tmp_path)


def test_each_is_listed_by_what_it_is_found_again_by(tmp_path: Path) -> None:
    plug_in(tmp_path, 0, '1-1', 'A1')
    plug_in(tmp_path, 2, '1-2', 'same')
    plug_in(tmp_path, 4, '1-3', 'same')
    plug_in(tmp_path, 10, '1-4', '')
    ports = tmp_path / 'by-path'
    ports.mkdir()
    (ports / 'pci-usb-0:2:1.0-video-index0').symlink_to('/dev/video2')
    listed = [source for source, _ in sources(cameras(tmp_path), ports)]
    assert listed == ['serial:A1', f'{ports}/pci-usb-0:2:1.0-video-index0', '/dev/video4', '/dev/video10']


def test_a_camera_that_comes_back_as_another_device_goes_on(
    device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, clock, opened = CameraSettings('serial:A1', fps=100.0), SystemClock(), []

    def check(path: str) -> None:
        opened.append(path)
        if not Path(path).exists():
            raise DeviceNotFoundError(f'there is no camera {path}')

    monkeypatch.setattr(v4l2, 'located', lambda _: str(device.node))
    camera = LiveCamera(
        'serial:A1', lambda: V4l2Connection(settings, clock, device.capture, device.access, check), clock, settings
    )
    camera.open()
    camera.read(20.0)
    deadline_s = clocks.monotonic_s() + 60

    def read_while(going_on: Callable[[], bool]) -> None:
        while going_on():
            assert clocks.monotonic_s() < deadline_s
            with contextlib.suppress(DeviceTimeoutError):
                camera.read(0.2)

    device.unplug()
    read_while(lambda: camera.health.level != Level.ERROR)
    device.node = tmp_path / 'video6'
    device.plug()
    read_while(lambda: camera.health.level == Level.ERROR)
    camera.close()
    assert opened[-1] == str(tmp_path / 'video6')
    assert camera.description['source'] == 'serial:A1'


def test_a_source_by_serial_number_is_a_camera_and_no_file() -> None:
    with pytest.raises(DeviceNotFoundError, match="no camera has the serial number 'none-such'"):
        open_camera(CameraSettings('serial:none-such'), SystemClock())
