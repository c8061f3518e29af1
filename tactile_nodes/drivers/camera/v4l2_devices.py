"""Which V4L2 devices there are, where one is that is named by its serial number, and why one cannot be opened."""

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
    """A video device as the kernel lists it. `serial` is that of its USB device, which may have none: ''."""

    path: str
    name: str
    serial: str


def cameras(sysfs: Path = SYSFS) -> list[UsbCamera]:
    """The devices that may bring pictures: of each camera its first node, in the order of their numbers."""
    nodes = sorted((int(node.name[5:]), node) for node in sysfs.glob('video[0-9]*') if node.name[5:].isdigit())
    return [
        UsbCamera(f'/dev/{node.name}', _line(node / 'name'), _line(node / 'device' / '..' / 'serial'))
        for _, node in nodes
        if _line(node / 'index') in {'', '0'}
    ]


def device_path(source: str) -> str:
    """``0`` is ``/dev/video0``; everything else is a path, or a serial number, already."""
    source = source.strip()
    return f'/dev/video{int(source)}' if source.isdigit() else source


def located(name: str, sysfs: Path = SYSFS) -> str:
    """The path of a device that may be named by its serial number, ``serial:A1B2``, wherever it is plugged in now.

    Raises:
        DeviceNotFoundError: no camera has it, or several have.
    """
    if not name.startswith(SERIAL):
        return name
    wanted, there = name.removeprefix(SERIAL), cameras(sysfs)
    found = [each.path for each in there if each.serial == wanted]
    if len(found) > 1:
        raise DeviceNotFoundError(
            f'the cameras {" and ".join(found)} have one serial number, {wanted}; '
            'name each by its path below /dev/v4l/by-path, which follows from the USB port'
        )
    if not found:
        known = ', '.join(each.serial for each in there if each.serial) or 'none'
        raise DeviceNotFoundError(
            f'there is no camera with the serial number {wanted!r} (there are: {known}); plug it in, or look with: '
            'tactile camera list'
        )
    return found[0]


def check_device(path: str, by_id: Path = BY_ID) -> None:
    """Say why a device cannot be opened before OpenCV only says that it cannot.

    Raises:
        DeviceNotFoundError: it is not there, not this user's, or not a camera.
    """
    if not Path(path).exists():
        raise DeviceNotFoundError(f'there is no camera {path}; {_known(by_id)}')
    if not os.access(path, os.R_OK | os.W_OK):
        raise DeviceNotFoundError(
            f'no permission to open the camera {path}; '
            'join its group with: sudo usermod -aG video $USER, then log in again'
        )
    try:
        found = capability(path)
    except OSError as error:
        if error.errno in {errno.EBUSY, errno.EINTR}:
            return
        raise DeviceNotFoundError(f'{path} is no video device ({error.strerror}); {_known(by_id)}') from error
    if not found.captures:
        raise DeviceNotFoundError(
            f'{path} of {found.card} carries no pictures (a UVC camera has a second node for metadata); '
            'take the other node of this camera'
        )


@dataclass(frozen=True)
class Capability:
    """Who a device node says it is."""

    card: str
    driver: str
    captures: bool


def capability(path: str) -> Capability:
    """Ask a node what it is: the second node of a UVC camera carries metadata and no pictures.

    Raises:
        OSError: it cannot be opened (EACCES, EBUSY), or is no V4L2 device (ENOTTY).
    """
    file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        answer = fcntl.ioctl(file, _QUERYCAP, bytes(_CAPABILITY.size))
    finally:
        os.close(file)
    driver, card, _bus, _version, of_device, of_node = _CAPABILITY.unpack(answer)
    valid = of_node if of_device & _CAP_DEVICE_CAPS else of_device
    return Capability(_text(card), _text(driver), bool(valid & _CAP_CAPTURE))


def _line(file: Path) -> str:
    """What the kernel says in a file of a line; nothing where it says nothing."""
    try:
        return read_text(file, LINE_BYTES, 'latin-1').strip()
    except OSError:
        return ''


def _text(field: bytes) -> str:
    return field.split(b'\0', 1)[0].decode('utf-8', 'replace')


def _known(by_id: Path) -> str:
    names = sorted(str(path) for path in by_id.iterdir()) if by_id.is_dir() else []
    if names:
        return f'there are {", ".join(names)}'
    return f'no USB camera is plugged in ({by_id} is empty or missing); plug one in, or use source simulated'
