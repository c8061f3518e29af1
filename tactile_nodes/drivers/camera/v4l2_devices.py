"""Lists V4L2 devices, finds one by its serial number, and explains why one cannot be opened."""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from dataclasses import dataclass
from pathlib import Path

from tactile_nodes.drivers.camera.contract import SERIAL
from tactile_nodes.errors import DeviceNotFoundError
from tactile_nodes.files import read_text

BY_ID = Path('/dev/v4l/by-id')
SYSFS = Path('/sys/class/video4linux')
# From linux/videodev2.h:
_QUERYCAP = 0x80685600
_CAPABILITY = struct.Struct('16s32s32sIII12x')  # struct v4l2_capability: driver, card, bus, version, all, this node
LINE_BYTES = 4096
_CAP_CAPTURE = 0x00000001 | 0x00001000  # single- and multi-planar
_CAP_DEVICE_CAPS = 0x80000000


@dataclass(frozen=True)
class UsbCamera:
    """A video device as listed by the kernel. `serial` is that of its USB device, or '' if it has none."""

    path: str
    name: str
    serial: str


def cameras(sysfs: Path = SYSFS) -> list[UsbCamera]:
    """The devices that may be cameras: the first node of each camera, sorted by number."""
    nodes = sorted((int(node.name[5:]), node) for node in sysfs.glob('video[0-9]*') if node.name[5:].isdigit())
    return [
        UsbCamera(f'/dev/{node.name}', _line(node / 'name'), _line(node / 'device' / '..' / 'serial'))
        for _, node in nodes
        if _line(node / 'index') in {'', '0'}
    ]


def device_path(source: str) -> str:
    """``0`` becomes ``/dev/video0``; any other source is a path or a serial number already."""
    source = source.strip()
    return f'/dev/video{int(source)}' if source.isdigit() else source


def located(name: str, sysfs: Path = SYSFS) -> str:
    """The path of a device; a serial number ``serial:A1B2`` is looked up at all ports.

    Raises:
        DeviceNotFoundError: no camera or several cameras have this serial number.
    """
    if not name.startswith(SERIAL):
        return name
    wanted, there = name.removeprefix(SERIAL), cameras(sysfs)
    found = [each.path for each in there if each.serial == wanted]
    if len(found) > 1:
        raise DeviceNotFoundError(
            f'the cameras {" and ".join(found)} have the same serial number, {wanted}; '
            'use their paths below /dev/v4l/by-path, which depend on the USB port'
        )
    if not found:
        serials = ', '.join(each.serial for each in there if each.serial) or 'none'
        raise DeviceNotFoundError(
            f'no camera has the serial number {wanted!r} (found: {serials}); connect it, or list cameras with: '
            'tactile camera list'
        )
    return found[0]


def check_device(path: str, by_id: Path = BY_ID) -> None:
    """Find out why a device cannot be opened, since OpenCV gives no reason.

    Raises:
        DeviceNotFoundError: it does not exist, this user may not open it, or it is not a camera.
    """
    if not Path(path).exists():
        raise DeviceNotFoundError(f'there is no camera {path}; {_connected(by_id)}')
    if not os.access(path, os.R_OK | os.W_OK):
        raise DeviceNotFoundError(
            f'no permission to open the camera {path}; '
            'add yourself to its group: sudo usermod -aG video $USER, then log in again'
        )
    try:
        card, captures = capability(path)
    except OSError as error:
        if error.errno in {errno.EBUSY, errno.EINTR}:
            return
        raise DeviceNotFoundError(f'{path} is not a video device ({error.strerror}); {_connected(by_id)}') from error
    if not captures:
        raise DeviceNotFoundError(
            f'{path} of {card} is not a picture stream (a UVC camera has a second node for metadata); '
            'use the other node of this camera'
        )


def capability(path: str) -> tuple[str, bool]:
    """Name of the device of a node, and whether it captures pictures; the second node of a UVC camera does not.

    Raises:
        OSError: it cannot be opened (EACCES, EBUSY), or is not a V4L2 device (ENOTTY).
    """
    file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        answer = fcntl.ioctl(file, _QUERYCAP, bytes(_CAPABILITY.size))
    finally:
        os.close(file)
    _driver, card, _bus, _version, of_device, of_node = _CAPABILITY.unpack(answer)
    valid = of_node if of_device & _CAP_DEVICE_CAPS else of_device
    return card.split(b'\0', 1)[0].decode('utf-8', 'replace'), bool(valid & _CAP_CAPTURE)


def _line(file: Path) -> str:
    """The content of a one-line file; empty if it cannot be read."""
    try:
        return read_text(file, LINE_BYTES, 'latin-1').strip()
    except OSError:
        return ''


def _connected(by_id: Path) -> str:
    names = sorted(str(path) for path in by_id.iterdir()) if by_id.is_dir() else []
    if names:
        return f'found: {", ".join(names)}'
    return f'no USB camera is connected ({by_id} is empty or missing); connect one, or use source simulated'
