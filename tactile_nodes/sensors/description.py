"""The description of a sensor: its image, camera, gel and pattern in one YAML file, checked for contradictions.

Frames: the surface frame has its origin at the middle of the gel's surface, x to the right and y down in the image, z
out of the gel. The camera looks along +z, is tilted about its x, then its y axis, then rolled about z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tactile_nodes.params import parameter
from tactile_nodes.sensors.covering import MaskSettings
from tactile_nodes.sensors.dome import Dome
from tactile_nodes.sensors.mounting import Mounting
from tactile_nodes.sensors.outline import Outline
from tactile_nodes.shapes import Bool

LEAST_CLEARANCE_MM = 0.5
"""Least distance between the camera's pupil and the lowest marker."""

LENGTHS = {'centre_px': 2, 'position_mm': 3, 'tilt_deg': 2, 'focal_px': 2, 'distortion': 5}
"""How many numbers each list entry of `camera` has."""

FISHEYE_LENS = 4
"""How many distortion coefficients of a fisheye may differ from 0."""


LEAST_BELOW_MM = 0.2
"""Least thickness at the rim of a dome: of the gel below the lowest markers, and of the lowest layer."""

MOST_MM = 500.0
"""Greatest size of a gel, along any side."""

SOFTEST_MPA, HARDEST_MPA, MOST_OFF = 1e-4, 20.0, 1.0
"""Limits of shear moduli, from the softest jelly to hard rubber, and of their uncertainty as a share."""

MOST_SLENDER = 40.0
"""Width over thickness up to which the effect of the sides is computed."""

SIDES = 'ignored', 'free', 'held'
"""What is known of the sides of a gel."""

LEAST_FILLED, MOST_FILLED = 1 / 8, 8.0
"""Limits of the gel's size over the image's, along both sides, by focal length and distance."""

MOST_TILT_DEG = 80.0
"""Camera tilt beyond which the distance to the gel no longer grows in the estimate of its size."""

STEPS = 100
"""Places at which a lens is checked, from the axis to the corner of the image."""


@dataclass(frozen=True)
class ImageSettings:
    """Images as the camera delivers them, and the part cropped from their middle."""

    width: int = parameter(640, 'width of the camera image [px]', minimum=40)
    height: int = parameter(480, 'height of the camera image [px]', minimum=40)
    crop: int = parameter(440, 'width of the crop that is used [px]', minimum=40)
    crop_height: int = parameter(0, 'height of the crop [px]; 0: as its width', minimum=0)

    def __post_init__(self) -> None:
        width, height = self.crop_px
        if width > self.width or height > self.height:
            raise ValueError(
                f'image.crop is {width}x{height}, but the image has only {self.width}x{self.height} pixels'
            )
        if height < 40:
            raise ValueError(f'image.crop_height is {height}, but must be 0 or at least 40')

    @property
    def crop_px(self) -> tuple[int, int]:
        return self.crop, self.crop_height or self.crop


@dataclass(frozen=True)
class CameraDescription:
    """The lens model and pose of the camera: `position_mm` is the position of its entrance pupil in the surface frame.

    Both lens models are OpenCV's, as in ROS's `camera_info`: a fisheye is equidistant apart from its distortion.
    """

    model: str = parameter('fisheye', 'lens model', choices=('fisheye', 'pinhole'))
    focal_px_per_rad: float = parameter(290.0, 'focal length of a fisheye: pixels per radian', minimum=1.0)
    focal_px: tuple[float, ...] = parameter((600.0, 600.0), 'focal lengths of a pinhole along u and v')
    distortion: tuple[float, ...] = parameter((0.0,) * 5, 'k1, k2, p1, p2, k3 of a pinhole; k1 to k4, 0 of a fisheye')
    centre_px: tuple[float, ...] = parameter((319.5, 239.5), 'principal point (u, v)')
    position_mm: tuple[float, ...] = parameter((0.0, 0.0, -23.0), 'entrance pupil in the surface frame')
    tilt_deg: tuple[float, ...] = parameter((0.0, 0.0), 'rotation about x, then about y')
    roll_deg: float = parameter(0.0, 'rotation about the optical axis')
    focal_ratio: float = parameter(1.0, 'focal length of a fisheye along v over that along u', minimum=0.1)

    def __post_init__(self) -> None:
        for name, count in LENGTHS.items():
            if len(getattr(self, name)) != count:
                raise ValueError(f'camera.{name} must hold {count} numbers, got {len(getattr(self, name))}')
        if min(self.focal_px) <= 0:
            raise ValueError('camera.focal_px must hold numbers above 0')
        if self.model == 'fisheye' and self.distortion[FISHEYE_LENS]:
            raise ValueError('camera.distortion of a fisheye has four coefficients, k1 to k4; the fifth must be 0')

    @property
    def distortion_model(self) -> str:
        """The name of the distortion model in ROS's `camera_info`."""
        return 'equidistant' if self.model == 'fisheye' else 'plumb_bob'

    @property
    def lens(self) -> tuple[float, ...]:
        """The coefficients of that model."""
        return self.distortion[:FISHEYE_LENS] if self.model == 'fisheye' else self.distortion

    @property
    def matrix(self) -> tuple[tuple[float, ...], ...]:
        """OpenCV's camera matrix: focal lengths and centre (px)."""
        (across, down), (u, v) = self.focal_lengths_px, self.centre_px
        return (across, 0.0, u), (0.0, down, v), (0.0, 0.0, 1.0)

    @property
    def focal_lengths_px(self) -> tuple[float, float]:
        """Focal lengths along u and v, for both models."""
        if self.model == 'fisheye':
            return self.focal_px_per_rad, self.focal_px_per_rad * self.focal_ratio
        across, down = self.focal_px
        return across, down

    def extent_px(self, width_mm: float, height_mm: float) -> tuple[float, float]:
        """The size of a gel in the image by the angle that it fills, without lens distortion and most of a tilt."""
        leans = math.prod(math.cos(math.radians(min(abs(each), MOST_TILT_DEG))) for each in self.tilt_deg)
        wide, high = (side / 2 * leans / -self.position_mm[2] for side in (width_mm, height_mm))
        if self.model == 'fisheye':
            wide, high = math.atan(wide), math.atan(high)
        across, down = self.focal_lengths_px
        return 2 * across * wide, 2 * down * high

    def shows(self, across_px: float, down_px: float) -> bool:
        """Whether the lens maps directions one to one, up to this distance from the optical axis along u and v."""
        across, down = self.focal_lengths_px
        reach = math.hypot(across_px / across, down_px / down)
        angle = [reach * step / STEPS for step in range(3 * STEPS)]
        powers = self.lens if self.model == 'fisheye' else (self.distortion[0], self.distortion[1], self.distortion[4])
        for each in angle:
            stretch = 1 + sum(k * each ** (2 * n) for n, k in enumerate(powers, 1))
            slope = 1 + sum((2 * n + 1) * k * each ** (2 * n) for n, k in enumerate(powers, 1))
            if each * stretch >= angle[STEPS]:
                return True
            if slope <= 0:
                return False
        return False


@dataclass(frozen=True)
class GelDescription:
    """A gel of layers on a rigid base. Each list has one entry a layer, from the surface down."""

    width_mm: float = parameter(32.0, 'size along x', minimum=1.0)
    height_mm: float = parameter(32.0, 'size along y', minimum=1.0)
    layers_mm: tuple[float, ...] = parameter((1.5, 4.5), 'thickness of each layer')
    moduli_mpa: tuple[float, ...] = parameter((0.111, 0.111), 'shear modulus of each layer')
    poisson_ratios: tuple[float, ...] = parameter((0.5, 0.5), 'ratio of each layer, at most 0.5 (incompressible)')
    markers_mm: tuple[float, ...] = parameter((1.5, 6.0), 'depths between which the visible pattern lies')
    moduli_off: float = parameter(
        0.9, 'relative standard deviation of the moduli: 0.9 if they were not measured', minimum=0.0
    )
    outline_mm: str = parameter('', "part of the rectangle that is gel: empty (all), ellipse, or corners 'x,y x,y x,y'")
    dome_radius_mm: float = parameter(0.0, 'radius of a spherical surface; 0: it is flat', minimum=0.0)
    sides: str = parameter(
        'ignored', 'of the gel: free, held by a rigid frame, or ignored, as if the gel went on', choices=SIDES
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
            raise ValueError(
                f'gel.markers_mm must hold two depths within the {self.depth_mm:g} mm of gel.layers_mm, the '
                'smaller one first: [0.3, 0.4] for dots printed 0.3 mm deep'
            )
        self._require_real()
        self._require_shallow()
        if self.sides != 'ignored' and not self.may_have_sides:
            raise ValueError(
                f'gel.sides is {self.sides}, which only a flat rectangular gel can have that is at most '
                f'{MOST_SLENDER:g} times as wide as thick; for any other gel it must be ignored'
            )

    def _require_real(self) -> None:
        """Refuse values that suggest a wrong unit or digit. Raises ValueError."""
        for name, value in (('width_mm', self.width_mm), ('height_mm', self.height_mm), ('layers_mm', self.depth_mm)):
            if not value <= MOST_MM:
                raise ValueError(
                    f'gel.{name} has {value:g} mm, but at most {MOST_MM:g} is allowed: lengths are in millimetres'
                )
        for value in self.moduli_mpa:
            if not SOFTEST_MPA <= value <= HARDEST_MPA:
                raise ValueError(
                    f'gel.moduli_mpa holds {value:g}, but shear moduli of gels lie between {SOFTEST_MPA:g} and '
                    f'{HARDEST_MPA:g} MPa: 100 kPa are 0.1'
                )
        if not self.moduli_off <= MOST_OFF:
            raise ValueError(
                f'gel.moduli_off is {self.moduli_off:g}, but must be at most {MOST_OFF:g}: it is a share, 0.6 is 60 %'
            )

    def _require_shallow(self) -> None:
        """Refuse a dome that is steep, or too thin at its rim. Raises ValueError."""
        self.dome.require_shallow(self.outline.farthest_mm)
        left_mm = min(self.layers_mm[-1], self.depth_mm - self.markers_mm[1])
        if self.dome_radius_mm and self.sag_mm > left_mm - LEAST_BELOW_MM:
            raise ValueError(
                f'gel.dome_radius_mm makes the surface {self.sag_mm:.2f} mm lower at its rim than in the middle; below '
                f'gel.markers_mm, and in the lowest of gel.layers_mm, there must be {LEAST_BELOW_MM} mm more than that'
            )

    @property
    def may_have_sides(self) -> bool:
        """Whether the effect of sides can be computed: of a flat rectangle that is not very thin."""
        slender = max(self.width_mm, self.height_mm) / self.depth_mm
        return slender <= MOST_SLENDER and not (self.outline_mm or self.dome_radius_mm)

    @property
    def depth_mm(self) -> float:
        """Thickness of all layers."""
        return float(sum(self.layers_mm))

    @property
    def dome(self) -> Dome:
        return Dome(self.dome_radius_mm)

    @property
    def sag_mm(self) -> float:
        """How much lower the surface is at the point of the rim farthest from the middle; 0 for a flat surface."""
        return -float(self.dome.height_mm(self.outline.corners_mm).min())

    @property
    def outline(self) -> Outline:
        return Outline(self.width_mm, self.height_mm, self.outline_mm)


@dataclass(frozen=True)
class PatternDescription:
    """The visible pattern between the depths `gel.markers_mm`."""

    kind: str = parameter('spheres', 'random spheres, or dots in rows and columns', choices=('spheres', 'dots'))
    count: int = parameter(10_000, 'number of spheres in the whole gel', minimum=1)
    diameter_mm: tuple[float, ...] = parameter((0.15, 0.18), 'least and greatest diameter')
    pitch_mm: float = parameter(2.0, 'distance between dots along x and along y', minimum=0.1)
    dark: bool = parameter(False, 'whether the pattern is darker than its surroundings')
    dot_mm: tuple[float, ...] = parameter((0.0, 0.0), 'position of one of the dots on the surface (x, y)')

    def __post_init__(self) -> None:
        if len(self.dot_mm) != 2:
            raise ValueError(f'pattern.dot_mm must hold two numbers, got {len(self.dot_mm)}')
        if len(self.diameter_mm) != 2 or not 0 < self.diameter_mm[0] <= self.diameter_mm[1]:
            raise ValueError('pattern.diameter_mm must hold two numbers above 0, the least one first')
        if self.kind == 'dots' and self.diameter_mm[1] >= self.pitch_mm:
            raise ValueError(
                f'pattern.diameter_mm is {self.diameter_mm[1]:g}, so dots at a distance of pattern.pitch_mm, '
                f'{self.pitch_mm:g} mm, would touch'
            )

    def require_within(self, gel: GelDescription) -> None:
        """Refuse a gel that holds less than a row of dots. Raises ValueError."""
        side = min(gel.width_mm, gel.height_mm)
        if self.kind == 'dots' and self.pitch_mm > side:
            raise ValueError(
                f'pattern.pitch_mm is {self.pitch_mm:g}, but the shorter side of the gel is {side:g} mm: the pitch is '
                'the distance from one dot to the next'
            )


@dataclass(frozen=True)
class BinSettings:
    """The bins on the surface that forces are reported on."""

    rows: int = parameter(9, 'number of bins along y', minimum=1, maximum=64)
    cols: int = parameter(9, 'number of bins along x', minimum=1, maximum=64)
    width_mm: float = parameter(0.0, 'width of the grid along x; 0: that of the gel', minimum=0.0)
    height_mm: float = parameter(0.0, 'height of the grid along y; 0: that of the gel', minimum=0.0)
    centre_mm: tuple[float, ...] = parameter((0.0, 0.0), 'centre of the grid on the surface')

    def require_within(self, gel: GelDescription) -> None:
        """Refuse bins outside the gel. Raises ValueError."""
        if len(self.centre_mm) != 2:
            raise ValueError(f'bins.centre_mm must hold 2 numbers, got {len(self.centre_mm)}')
        for at, own, side in zip(
            self.centre_mm, (self.width_mm, self.height_mm), (gel.width_mm, gel.height_mm), strict=True
        ):
            if not abs(at) + (own or side) / 2 <= side / 2 + 1e-6:
                raise ValueError(
                    f'bins reach {abs(at) + (own or side) / 2:g} mm from the middle, but the gel ends at '
                    f'{side / 2:g} mm; change bins.width_mm, bins.height_mm or bins.centre_mm'
                )


@dataclass(frozen=True)
class Sensor:
    """All that must be known of a sensor before the first press."""

    name: str = parameter('', 'name of the sensor')
    image: ImageSettings = field(default_factory=ImageSettings)
    camera: CameraDescription = field(default_factory=CameraDescription)
    gel: GelDescription = field(default_factory=GelDescription)
    pattern: PatternDescription = field(default_factory=PatternDescription)
    bins: BinSettings = field(default_factory=BinSettings)
    mask: MaskSettings = field(default_factory=MaskSettings)
    frame: Mounting = field(default_factory=Mounting)

    @property
    def covered(self) -> Bool[np.ndarray, 'h w']:
        """Which pixels of the crop show no gel, according to the mask."""
        (width, height), image = self.image.crop_px, self.image
        x, y = (image.width - width) // 2, (image.height - height) // 2
        return self.mask.covers(image.width, image.height)[y : y + height, x : x + width]

    def __post_init__(self) -> None:
        self.bins.require_within(self.gel)
        lowest = -self.gel.markers_mm[1]
        if self.camera.position_mm[2] > lowest - LEAST_CLEARANCE_MM:
            raise ValueError(
                f'camera.position_mm has the height {self.camera.position_mm[2]:g} mm, which is not below the markers; '
                f'the lowest marker is at {lowest:g} mm'
            )
        u, v = self.camera.centre_px
        if not (0 <= u < self.image.width and 0 <= v < self.image.height):
            raise ValueError(
                f'camera.centre_px ({u:g}, {v:g}) lies outside the {self.image.width}x{self.image.height} image'
            )
        if not self.camera.shows(*map(_farthest, (u, v), (self.image.width, self.image.height), self.image.crop_px)):
            raise ValueError(
                f'camera.distortion {list(self.camera.distortion)} folds the image over before its corner; check it '
                'and camera.centre_px, calibrate the camera again, or use less of the image (image.crop)'
            )
        if self.mask.polygons_px and self.covered.all():
            raise ValueError('mask covers the whole image; black parts and polygons mark what to leave out')
        self.mask.require_within(self.image.width, self.image.height)
        self.pattern.require_within(self.gel)
        self._require_seen()

    def _require_seen(self) -> None:
        """Refuse a gel that is far larger or far smaller than the image. Raises ValueError."""
        wide, high = self.camera.extent_px(self.gel.width_mm, self.gel.height_mm)
        width, height = self.image.crop_px
        times = wide / width, high / height
        if max(times) >= LEAST_FILLED and min(times) <= MOST_FILLED:
            return
        focal = 'camera.focal_px_per_rad' if self.camera.model == 'fisheye' else 'camera.focal_px'
        raise ValueError(
            f'{focal} and camera.position_mm make the gel {wide:.0f}x{high:.0f} pixels large, but the crop has '
            f'{width}x{height}; check them, gel.width_mm and gel.height_mm'
        )


def _farthest(at_px: float, side_px: int, crop_px: int) -> float:
    """Distance of the farther end of a centred crop along one side of the image: 379.5 of 640 px about 260."""
    first = (side_px - crop_px) // 2 - 0.5  # the middle of a pixel is a whole number
    return max(at_px - first, first + crop_px - at_px)
