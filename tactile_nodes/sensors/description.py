"""The description of a sensor: what its picture shows of which gel, in one YAML file that contradicts itself nowhere.

Frames: the surface frame has its origin at the middle of the gel's surface, x to the right and y down in the image, z
out of the gel. The camera looks along +z, is tilted about its x, then its y axis, then rolled about z.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import from_mapping, load_mapping, parameter
from tactile_nodes.paths import share_directory

LEAST_CLEARANCE_MM = 0.5
"""Between the camera's pupil and the lowest marker."""

LENGTHS = {'centre_px': 2, 'position_mm': 3, 'tilt_deg': 2, 'focal_px': 2, 'distortion': 5}
"""How many numbers belong to the entries of `camera` that hold several."""


@dataclass(frozen=True)
class ImageSettings:
    """Pictures as they come from the camera, and the part that is cut from their middle."""

    width: int = parameter(640, 'of a picture [px]', minimum=40)
    height: int = parameter(480, 'of a picture [px]', minimum=40)
    crop: int = parameter(440, 'width of the part that is looked at [px]', minimum=40)
    crop_height: int = parameter(0, 'its height [px]; 0: the same, a square', minimum=0)

    def __post_init__(self) -> None:
        width, height = self.crop_px
        if width > self.width or height > self.height:
            raise ValueError(
                f'image.crop is {width}x{height}, and pictures have only {self.width}x{self.height} pixels'
            )
        if height < 40:
            raise ValueError(f'image.crop_height is {height}, and must be 0 or at least 40')

    @property
    def crop_px(self) -> tuple[int, int]:
        """Width and height of what is looked at."""
        return self.crop, self.crop_height or self.crop


@dataclass(frozen=True)
class CameraDescription:
    """How angles become pixels, and where it is: `position_mm` is its entrance pupil's place in the surface frame.

    A fisheye is equidistant. A pinhole has OpenCV's lens distortion, as ROS's `camera_info` tells it.
    """

    model: str = parameter('fisheye', 'how angles become pixels', choices=('fisheye', 'pinhole'))
    focal_px_per_rad: float = parameter(290.0, 'of a fisheye: pixels from the centre for each radian', minimum=1.0)
    focal_px: tuple[float, ...] = parameter((600.0, 600.0), 'of a pinhole: focal lengths along u and v')
    distortion: tuple[float, ...] = parameter((0.0,) * 5, 'of a pinhole: k1, k2, p1, p2, k3 (plumb_bob)')
    centre_px: tuple[float, ...] = parameter((319.5, 239.5), 'where the optical axis meets the picture (u, v)')
    position_mm: tuple[float, ...] = parameter((0.0, 0.0, -23.0), 'the pupil in the surface frame')
    tilt_deg: tuple[float, ...] = parameter((0.0, 0.0), 'about x, then about y')
    roll_deg: float = parameter(0.0, 'about the optical axis')

    def __post_init__(self) -> None:
        for name, count in LENGTHS.items():
            if len(getattr(self, name)) != count:
                raise ValueError(f'camera.{name} must hold {count} numbers, got {len(getattr(self, name))}')
        if min(self.focal_px) <= 0:
            raise ValueError('camera.focal_px must hold numbers above 0')

    @property
    def distortion_model(self) -> str:
        """As ROS's `camera_info` names it."""
        return 'equidistant' if self.model == 'fisheye' else 'plumb_bob'

    @property
    def lens(self) -> tuple[float, ...]:
        """Coefficients of that: none of a fisheye differs from 0."""
        return (0.0,) * 4 if self.model == 'fisheye' else self.distortion

    @property
    def matrix(self) -> tuple[tuple[float, ...], ...]:
        """OpenCV's camera matrix: focal lengths and centre (px)."""
        across, down = (self.focal_px_per_rad,) * 2 if self.model == 'fisheye' else self.focal_px
        u, v = self.centre_px
        return (across, 0.0, u), (0.0, down, v), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class GelDescription:
    """A gel of layers on a rigid base. Each list has one entry a layer, from the surface down."""

    width_mm: float = parameter(32.0, 'along x', minimum=1.0)
    height_mm: float = parameter(32.0, 'along y', minimum=1.0)
    layers_mm: tuple[float, ...] = parameter((1.5, 4.5), 'thickness of each layer')
    moduli_mpa: tuple[float, ...] = parameter((0.111, 0.111), 'shear modulus of each layer')
    poisson_ratios: tuple[float, ...] = parameter((0.5, 0.5), 'of each layer, at most 0.5 (incompressible)')
    markers_mm: tuple[float, ...] = parameter((1.5, 6.0), 'depths between which what is visible lies')
    moduli_off: float = parameter(
        0.6, 'share by which the moduli may be off, as a standard deviation: 0.6 if nobody measured them', minimum=0.0
    )

    def __post_init__(self) -> None:
        count = len(self.layers_mm)
        for name in ('moduli_mpa', 'poisson_ratios'):
            if len(getattr(self, name)) != count:
                raise ValueError(f'gel.{name} must hold {count} numbers, one for each of gel.layers_mm')
        if not count or min(*self.layers_mm, *self.moduli_mpa) <= 0:
            raise ValueError('gel.layers_mm and gel.moduli_mpa must hold numbers above 0')
        if not all(0 <= each <= 0.5 for each in self.poisson_ratios):
            raise ValueError('gel.poisson_ratios must lie between 0 and 0.5')
        if len(self.markers_mm) != 2 or not 0 <= self.markers_mm[0] < self.markers_mm[1] <= self.depth_mm + 1e-9:
            raise ValueError(f'gel.markers_mm must hold two depths within the {self.depth_mm:g} mm of gel.layers_mm')

    @property
    def depth_mm(self) -> float:
        """Thickness of all layers."""
        return float(sum(self.layers_mm))


@dataclass(frozen=True)
class PatternDescription:
    """What is seen to move between the depths `gel.markers_mm`."""

    kind: str = parameter('spheres', 'at random, or printed in rows and columns', choices=('spheres', 'dots'))
    count: int = parameter(10_000, 'of spheres in the whole gel', minimum=1)
    diameter_mm: tuple[float, ...] = parameter((0.15, 0.18), 'least and greatest')
    pitch_mm: float = parameter(2.0, 'of dots, from one to the next along x and along y', minimum=0.1)
    dark: bool = parameter(False, 'whether they are darker than what is around them')

    def __post_init__(self) -> None:
        if len(self.diameter_mm) != 2 or not 0 < self.diameter_mm[0] <= self.diameter_mm[1]:
            raise ValueError('pattern.diameter_mm must hold two numbers above 0, the least one first')


@dataclass(frozen=True)
class BinSettings:
    """The bins on the surface that forces are reported on."""

    rows: int = parameter(9, 'along y', minimum=1, maximum=64)
    cols: int = parameter(9, 'along x', minimum=1, maximum=64)


@dataclass(frozen=True)
class Sensor:
    """All that has to be known of a sensor before anything is pressed."""

    name: str = parameter('', 'what it is called')
    image: ImageSettings = field(default_factory=ImageSettings)
    camera: CameraDescription = field(default_factory=CameraDescription)
    gel: GelDescription = field(default_factory=GelDescription)
    pattern: PatternDescription = field(default_factory=PatternDescription)
    bins: BinSettings = field(default_factory=BinSettings)

    def __post_init__(self) -> None:
        lowest = -self.gel.markers_mm[1]
        if self.camera.position_mm[2] > lowest - LEAST_CLEARANCE_MM:
            raise ValueError(
                f'camera.position_mm is {self.camera.position_mm[2]:g} mm high, which is not below the markers, '
                f'whose lowest lie at {lowest:g} mm'
            )


def load_sensor(name: Path | str) -> Sensor:
    """A description by the name of one that ships ('simulated'), or its file.

    Raises:
        ConfigurationError: there is none, an unknown key, or numbers that contradict each other.
    """
    shipped = share_directory() / 'config' / 'sensors' / f'{name}.yaml'
    file = shipped if shipped.is_file() else Path(name)
    if not file.is_file():
        known = ', '.join(sorted(each.stem for each in shipped.parent.glob('*.yaml')))
        raise ConfigurationError(f'there is no sensor {str(name)!r}; give a YAML file, or one that ships: {known}')
    return from_mapping(Sensor, load_mapping(file), source=str(file), exact=False)
