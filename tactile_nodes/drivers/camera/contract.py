"""What every camera does, what is asked of one, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from tactile_nodes.drivers.health import Health
from tactile_nodes.errors import ImageError
from tactile_nodes.params import parameter

if TYPE_CHECKING:
    from tactile_nodes.sensing.geometry import BinGrid
    from tactile_nodes.simulation.scene import Truth
    from tactile_nodes.simulation.worlds import ToldWorld

Picture = npt.NDArray[np.uint8]

SIMULATED, SERIAL = 'simulated', 'serial:'
"""The source that is no device, and what comes before the serial number of one."""


@dataclass(frozen=True)
class SceneSettings:
    """The world of the simulated camera; processes that give the same settings see the same world."""

    gel: str = parameter('', "YAML file of the gel's properties; empty: the gel of `sensor`, or the paper's")
    gel_seed: int = parameter(-1, 'where the markers are; -1: as in the file', minimum=-1)
    world: str = parameter('', 'name of a world that a node of this process shares, whose tip presses instead')
    seed: int = parameter(1, 'where and how deep the tip presses')
    contact: str = parameter(
        'tip', 'what touches the gel: tip; mixed, the tip and other bodies in turn; held, what a simulated gripper '
        'holds; or one contact alone: ring, edge, two and so on, a mesh (STL, OBJ, PLY), heights (NPY), or a '
        'description (YAML)',
    )  # fmt: skip
    start_ns: int = parameter(
        0, "nothing touches the gel before this time of the host's time base; 0: for a second after the start, or "
        'for 32 frames if those take longer', minimum=0,
    )  # fmt: skip
    period_s: float = parameter(2.0, 'from one press to the next', minimum=0.1)
    shallowest_mm: float = parameter(0.25, 'least depth of a press', minimum=0.0)
    deepest_mm: float = parameter(2.0, 'greatest depth of a press', minimum=0.0, maximum=2.5)


@dataclass(frozen=True)
class CameraSettings:
    """What is asked of a camera. A width, height, rate or control of 0 is left to the device."""

    READ_ONLY: ClassVar[bool] = True

    source: str = parameter(
        SIMULATED,
        'simulated, a device or its serial:NUMBER, a video file, a folder of images, or an http:// or rtsp:// address',
    )
    width: int = parameter(0, 'pixels; another size is refused; 0: what the source gives', minimum=0)
    height: int = parameter(0, 'pixels; another size is refused; 0: what the source gives', minimum=0)
    fps: float = parameter(60.0, 'frames per second, where the source does not say itself', minimum=0.0)
    fourcc: str = parameter('MJPG', 'pixel format asked of a V4L2 device; empty: what it has')
    exposure_ms: float = parameter(0.0, 'exposure time of a V4L2 device; 0: what it has', minimum=0.0)
    gain: int = parameter(-1, "gain of a V4L2 device in the device's own steps; -1: what it has", minimum=-1)
    white_balance_k: int = parameter(0, 'colour temperature of a V4L2 device; 0: what it has', minimum=0)
    keep_auto: bool = parameter(False, 'leave automatic exposure and white balance of a V4L2 device on')
    rate: float = parameter(1.0, 'speed of a file or folder; 0.0: as fast as it is read', minimum=0.0)
    loop: bool = parameter(False, 'start a file or folder again at its end')
    stall_s: float = parameter(1.5, 'a live source silent for this long counts as lost', minimum=0.1)
    sensor: str = parameter(
        '',
        'description of the sensor (name or file): what is cut from pictures, and what a simulated camera sees',
    )
    scene: SceneSettings = field(default_factory=SceneSettings)


@dataclass(frozen=True)
class Frame:
    """One picture and when it was taken.

    Attributes:
        image: (h, w) grey or (h, w, 3) blue-green-red, uint8, as the device sends it: neither cropped nor turned.
        stamp_ns: capture time on the host's time base (`clock`), as near to the exposure as the source allows;
            strictly increasing from frame to frame.
        sequence: number of the frame among all that the source is known to have made since it was opened.
        dropped: how many of those were lost so far: overtaken unread, damaged, or missing by their stamps.
            Between two frames that were read, the growth of `sequence` is one more than that of `dropped`.
    """

    image: Picture
    stamp_ns: int
    sequence: int
    dropped: int

    @property
    def encoding(self) -> str:
        """The image's `encoding` in `sensor_msgs/Image`: ``mono8`` or ``bgr8``."""
        return 'mono8' if self.image.ndim == 2 else 'bgr8'


class Camera(Protocol):
    """A source of frames."""

    @property
    def description(self) -> Mapping[str, str]:
        """What it is, what was asked of it and what it answered; keys and values for ``/diagnostics``."""
        ...

    @property
    def health(self) -> Health:
        """How it is now, in a sentence."""
        ...

    def open(self) -> None:
        """Start delivering frames.

        Raises:
            DeviceNotFoundError: nothing there, or nothing that this user may open.
            DeviceTimeoutError: it is there, and sends no picture.
            ImageError: its pictures have another size than the settings ask for, or cannot be read.
        """
        ...

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame; of a live source the newest. None: a finite source has come to its end.

        Raises:
            DeviceTimeoutError: no frame within `timeout_s`.
            DeviceLostError: it was there, and is not any more.
            DeviceError: it is not open.
            ImageError: a picture of another size, or one that cannot be read.
        """
        ...

    def close(self) -> None:
        """Let go of the device; a second call does nothing."""
        ...


@runtime_checkable
class KnowsTruth(Protocol):
    """A camera that looks at a made world, and so can say what a perfect sensor would feel there."""

    @property
    def bins(self) -> BinGrid:
        """The grid of the forces in `truth`."""
        ...

    def truth(self, stamp_ns: int) -> Truth:
        """The force on the gel in the frame with this stamp."""
        ...


@runtime_checkable
class IsTold(Protocol):
    """A camera of a made world that somebody else moves, and that takes in what touches there."""

    @property
    def told(self) -> ToldWorld | None:
        """Where to put what touches; None when it moves by itself."""
        ...


def check_size(image: npt.NDArray[Any], settings: CameraSettings, name: str) -> None:
    """Refuse a picture that has not the size that was asked for.

    Raises:
        ImageError: naming both sizes.
    """
    height, width = image.shape[:2]
    if settings.width in {0, width} and settings.height in {0, height}:
        return
    asked = f'{settings.width or "any"}x{settings.height or "any"}'
    raise ImageError(
        f'{name} gives pictures of {width}x{height}, asked for were {asked}; '
        f'set width and height of the camera to {width} and {height}, or to 0 to take what comes'
    )
