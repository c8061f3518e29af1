"""The controls of a V4L2 device, through the kernel's interface.

OpenCV's ``set`` returns True for a gain that a running auto-gain overrides. It has no property for auto-gain, nor for
the exposure mode that lowers the frame rate. The kernel's G_CTRL and S_CTRL report the actual values (Linux media
documentation, part I, VIDIOC_G_CTRL; numbers from linux/videodev2.h and linux/v4l2-controls.h), and work while OpenCV
streams.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from dataclasses import dataclass

from tactile_nodes.drivers.camera.contract import CameraSettings

_G_CTRL = 0xC008561B
_S_CTRL = 0xC008561C
_CONTROL = struct.Struct('Ii')  # struct v4l2_control: id, value

CONTROLS = {
    'white_balance_automatic': 0x0098090C,
    'autogain': 0x00980912,
    'gain': 0x00980913,
    'white_balance_temperature': 0x0098091A,  # K
    'auto_exposure': 0x009A0901,  # 1 manual, 3 aperture priority
    'exposure_time_absolute': 0x009A0902,  # 100 us
    'exposure_dynamic_framerate': 0x009A0903,
    'focus_automatic_continuous': 0x009A090C,
}

# In this order: a manual value is refused, or lost, while its automatic mode is on.
_MANUAL = {
    'auto_exposure': 1,
    'exposure_dynamic_framerate': 0,
    'autogain': 0,
    'white_balance_automatic': 0,
    'focus_automatic_continuous': 0,
}


class KernelControls:
    """Controls through ioctl, on a separate file descriptor, by the names of `CONTROLS`."""

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def get(self, name: str) -> int | None:
        """The value; None if the device has no such control."""
        try:
            answer = fcntl.ioctl(self._file, _G_CTRL, _CONTROL.pack(CONTROLS[name], 0))
        except OSError:  # EINVAL: no such control; EACCES: cannot be read; in both cases the value is unknown
            return None
        return int(_CONTROL.unpack(answer)[1])

    def set(self, name: str, value: int) -> None:
        """Request a value; a refusal shows when the value is read back."""
        try:
            fcntl.ioctl(self._file, _S_CTRL, _CONTROL.pack(CONTROLS[name], value))
        except OSError as error:
            if error.errno == errno.ENODEV:
                raise

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


@dataclass(frozen=True)
class Readback:
    """Requested and actual value of a control; None: the device does not have it."""

    name: str
    requested: int
    got: int | None
    needed: bool

    @property
    def complaint(self) -> str:
        """A message if a person should check it; empty if it is as requested, or if there was nothing to switch off."""
        if self.got == self.requested or (self.got is None and not self.needed):
            return ''
        return f'{self.name} is {"missing" if self.got is None else self.got}, but {self.requested} was requested'

    def __str__(self) -> str:
        return 'missing' if self.got is None else f'{self.got} (requested {self.requested})'


def wishes(settings: CameraSettings) -> dict[str, tuple[int, bool]]:
    """The values to request, in order, and whether a missing control should be reported.

    An exposure of 15.6 ms is 156 units of `exposure_time_absolute`.
    """
    wanted = {} if settings.keep_auto else {name: (value, False) for name, value in _MANUAL.items()}
    if settings.exposure_ms > 0:
        wanted['exposure_time_absolute'] = (round(settings.exposure_ms * 10), True)
    if settings.gain >= 0:
        wanted['gain'] = (settings.gain, True)
    if settings.white_balance_k > 0:
        wanted['white_balance_temperature'] = (settings.white_balance_k, True)
    return wanted


def apply(controls: KernelControls, settings: CameraSettings) -> list[Readback]:
    """Set the controls that differ from the request, then read all of them."""
    wanted = wishes(settings)
    for name, (value, _needed) in wanted.items():
        if controls.get(name) not in {None, value}:
            controls.set(name, value)
    return [Readback(name, value, controls.get(name), needed) for name, (value, needed) in wanted.items()]
