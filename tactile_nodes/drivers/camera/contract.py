"""The protocol of all cameras, with their settings and frames."""

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
    from tactile_nodes.simulation.worlds import InterpolatedWorld

Picture = npt.NDArray[np.uint8]

SIMULATED, SERIAL = 'simulated', 'serial:'
"""The name of the simulated source, and the prefix of a serial number."""


@dataclass(frozen=True)
class SceneSettings:
    """The world of the simulated camera; processes with the same settings see the same world."""

    gel: str = parameter('', "YAML file with the gel's properties; empty: the gel of `sensor`, or the paper's")
    gel_seed: int = parameter(-1, 'seed of the marker positions; -1: as in the file', minimum=-1)
    world: str = parameter('', 'name of a shared world in this process, whose tip presses instead')
    seed: int = parameter(1, 'seed of the positions and depths of presses')
    contact: str = parameter(
        'tip', 'what touches the gel: tip; mixed (the tip and other bodies in turn); held (the object in a simulated '
        'gripper); or one contact: ring, edge, two and so on, ball:5 or punch:1.5 (radius in mm), a '
        'mesh (STL, OBJ, PLY), heights (NPY), or a description (YAML)',
    )  # fmt: skip
    start_ns: int = parameter(
        0, "no contact before this time of the host's time base; 0: for a second after the start, or "
        'for 32 frames if those take longer', minimum=0,
    )  # fmt: skip
    period_s: float = parameter(2.0, 'time from one press to the next', minimum=0.1)
    shallowest_mm: float = parameter(0.25, 'smallest depth of a press', minimum=0.0)
    deepest_mm: float = parameter(2.0, 'largest depth of a press', minimum=0.0, maximum=2.5)


@dataclass(frozen=True)
class CameraSettings:
    """Requested camera settings. For width, height, rate and controls, 0 keeps the setting of the device."""

    READ_ONLY: ClassVar[bool] = True

    source: str = parameter(
        SIMULATED,
        'simulated, a device or its serial:NUMBER, a video file, a folder of images, or an http:// or rtsp:// address',
    )
    width: int = parameter(
        0, 'pixels; another size is refused; 0: as the source; used without `sensor`, whose size is required', minimum=0
    )
    height: int = parameter(0, 'as `width`', minimum=0)
    fps: float = parameter(60.0, 'frames per second, if the source does not report it', minimum=0.0)
    fourcc: str = parameter('MJPG', 'pixel format of a V4L2 device; empty: unchanged')
    exposure_ms: float = parameter(0.0, 'exposure time of a V4L2 device; 0: unchanged', minimum=0.0)
    gain: int = parameter(-1, "gain of a V4L2 device in the device's own steps; -1: unchanged", minimum=-1)
    white_balance_k: int = parameter(0, 'colour temperature of a V4L2 device; 0: unchanged', minimum=0)
    keep_auto: bool = parameter(False, 'leave automatic exposure and white balance of a V4L2 device on')
    rate: float = parameter(1.0, 'playback speed of a file or folder; 0.0: as fast as it is read', minimum=0.0)
    loop: bool = parameter(False, 'start a file or folder again at its end')
    stall_s: float = parameter(1.5, 'time without frames after which a live source counts as lost', minimum=0.1)
    sensor: str = parameter(
        '',
        'sensor description (name or file): the crop of pictures, and the sensor of a simulated camera',
    )
    scene: SceneSettings = field(default_factory=SceneSettings)


@dataclass(frozen=True)
class Frame:
    """One picture and its capture time.

    Attributes:
        image: (h, w) grey or (h, w, 3) blue-green-red, uint8, as sent by the device, not cropped or rotated.
        stamp_ns: capture time on the host's time base (`clock`), as close to the exposure as the source allows;
            strictly increasing from frame to frame.
        sequence: number of the frame among all that the source is known to have captured since it was opened.
        dropped: how many of those were lost so far: replaced before they were read, damaged, or missing by their
            stamps. Between two frames that were read, `sequence` grows by one more than `dropped`.
    """

    image: Picture
    stamp_ns: int
    sequence: int
    dropped: int


class Camera(Protocol):
    """A source of frames."""

    @property
    def description(self) -> Mapping[str, str]:
        """What it is, and its requested and actual settings; keys and values for ``/diagnostics``."""
        ...

    @property
    def health(self) -> Health:
        """Its current state, in a sentence."""
        ...

    def open(self) -> None:
        """Start delivering frames.

        Raises:
            DeviceNotFoundError: no device, or no permission to open it.
            DeviceTimeoutError: the device sends no picture.
            ImageError: its pictures have another size than requested, or cannot be read.
        """
        ...

    def read(self, timeout_s: float) -> Frame | None:
        """The next frame; for a live source the newest. None: a finite source has ended.

        Raises:
            DeviceTimeoutError: no frame within `timeout_s`.
            DeviceLostError: the device has disappeared.
            DeviceError: it is not open.
            ImageError: a picture of another size, or one that cannot be read.
        """
        ...

    def close(self) -> None:
        """Close the device; a second call does nothing."""
        ...


@runtime_checkable
class KnowsTruth(Protocol):
    """A camera of a simulated world, which knows what a perfect sensor would measure there."""

    @property
    def bins(self) -> BinGrid:
        """The grid of the forces in `truth`."""
        ...

    def truth(self, stamp_ns: int) -> Truth:
        """The true force on the gel in the frame with this stamp."""
        ...


@runtime_checkable
class HasDrivenWorld(Protocol):
    """A camera of a simulated world that another node moves. That node sends the contact."""

    @property
    def driven_world(self) -> InterpolatedWorld | None:
        """Where to store the contact; None if the world moves by itself."""
        ...


def check_size(image: npt.NDArray[Any], settings: CameraSettings, name: str) -> None:
    """Refuse a picture that does not have the requested size.

    Raises:
        ImageError: names both sizes.
    """
    height, width = image.shape[:2]
    if settings.width in {0, width} and settings.height in {0, height}:
        return
    requested = f'{settings.width or "any"}x{settings.height or "any"}'
    if settings.sensor:
        raise ImageError(
            f'{name} gives pictures of {width}x{height}, but image of {settings.sensor} says {requested}; set the '
            'camera to that size, or describe the sensor for its pictures'
        )
    raise ImageError(
        f'{name} gives pictures of {width}x{height}, but {requested} was requested; '
        f'set width and height of the camera to {width} and {height}, or to 0 to accept any size'
    )
