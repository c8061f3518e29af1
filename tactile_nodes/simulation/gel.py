"""A gel as data: all properties of one simulated sensor, as a small mapping (the content of a YAML file)."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensors import MOST_SLENDER, SIDES, Dome, Outline

CHOICES = {
    'mechanics': ('linear', 'finite_strain'),
    'contact': ('sticking', 'smooth'),
    'camera': ('fisheye', 'pinhole'),
    'pattern': ('spheres', 'dots'),
    'sides': SIDES,
}

BOUNDS = {
    'seed': (0, math.inf), 'size_mm': (0.1, 1000), 'height_mm': (0, 1000), 'soft_mm': (0, 100), 'skin_mm': (0, 100),
    'layer_mm': (0.1, 100), 'shear_modulus_mpa': (1e-4, 20), 'poisson_ratio': (0, 0.5), 'marker_count': (1, 1e6),
    'marker_diameter_mm': (1e-3, 100), 'tip_radius_mm': (0.01, 100), 'focal_px_per_rad': (1, 1e6),
    'image_width': (1, 10_000), 'image_height': (1, 10_000), 'blur_px': (0, 100), 'vignetting': (0, 0.99),
    'read_noise_grey': (0, 1000), 'shot_noise_grey': (0, 1000), 'settling_share': (0, 100), 'settling_s': (1e-3, 1e4),
    'exposure_s': (0, 10), 'jpeg_quality': (0, 100), 'light_gain': (0, 1000), 'focal_ratio': (0.01, 100),
    'pitch_mm': (0.05, 1000), 'markers_thickness_mm': (0, 100),
}  # fmt: skip
"""The least and the greatest value of a property; `layer_mm` is the sum of soft gel and skin."""

LATER = (
    'height_mm', 'camera', 'distortion', 'focal_ratio', 'centre_shift_px', 'pattern', 'pitch_mm',
    'markers_thickness_mm', 'outline', 'dome_radius_mm', 'dot_mm', 'sides',
)  # fmt: skip
"""Properties that were added later: a gel with their default values keeps its old id."""
LEFT_OUT = 'outline', 'dome_radius_mm', 'dot_mm', 'sides'
"""Properties that the card of a flat rectangle leaves out, so that it stays as before."""


@dataclass(frozen=True)
class Gel:
    """The paper's sensor: a stiff layer, a soft gel full of markers and a black skin, over a fisheye camera.

    The elastic layer of the mechanics is the soft gel with its skin, 6 mm thick, bonded to the stiff layer,
    which counts as rigid. The modulus is chosen so that the paper's tip needs about 1 N for 2 mm.
    `pupil_below_markers_mm` is the distance from the camera's entrance pupil to the lowest markers, including
    refraction at the lens. With `focal_px_per_rad` 88 % of the 40x40 regions of the 440x440 crop hold markers.

    `mechanics` is 'linear' (Hankel transform) or 'finite_strain' (finite elements); in the latter the `contact` is
    'sticking' or 'smooth'. `settling_share` is the excess of a sudden force over the settled one, as a share, and
    `settling_s` its time constant. `exposure_s` blurs what moves. `jpeg_quality` is that of the camera, 1 to 100, or 0
    for raw images. The camera is shifted, then tilted about x and y, then rolled about its axis. `light_slope` is the
    relative increase of brightness from the middle to half an image right of it, and below it.

    The gel is `size_mm` wide and `height_mm` high (0: as wide). A 'pinhole' camera has `focal_px_per_rad` pixels in the
    middle, and OpenCV's `distortion` (k1, k2, p1, p2, k3; of a fisheye k1 to k4, 0); `focal_ratio` is the focal length
    along v over that along u; `centre_shift_px` is the offset of the optical axis from the
    middle of the picture. The markers lie in the upper `markers_thickness_mm` of the soft gel (0: in all of it). They
    are `marker_count` random 'spheres', or 'dots' printed `pitch_mm` apart in rows and columns, one of them at
    `dot_mm`. A `marker_grey` below 0 makes them darker than the background.

    With an `outline`, as in a description, markers and presses lie only within it; the gel deforms as if it continued
    beyond. With a `dome_radius_mm` the surface and all markers lie lower towards the rim, and tips press along the
    surface's normal. The gel then deforms as if it had the thickness of the middle, and motion tilts with the surface.
    With `sides` that are 'free', or 'held' by a rigid frame, their effect is added (`simulation.sides`); bodies deform
    the surface under them as if it had none.
    """

    seed: int = 1
    size_mm: float = 32.0
    soft_mm: float = 4.5
    skin_mm: float = 1.5
    shear_modulus_mpa: float = 0.111
    poisson_ratio: float = 0.5
    marker_count: int = 10_000
    marker_diameter_mm: tuple[float, float] = (0.150, 0.180)
    tip_radius_mm: float = 0.6
    pupil_below_markers_mm: float = 17.0
    focal_px_per_rad: float = 290.0
    image_width: int = 640
    image_height: int = 480
    blur_px: float = 0.55
    background_grey: float = 14.0
    marker_grey: float = 150.0
    vignetting: float = 0.35
    read_noise_grey: float = 1.2
    shot_noise_grey: float = 0.05
    mechanics: str = 'finite_strain'
    contact: str = 'sticking'
    settling_share: float = 0.0
    settling_s: float = 0.5
    exposure_s: float = 0.0
    jpeg_quality: int = 0
    camera_shift_mm: tuple[float, float] = (0.0, 0.0)
    camera_tilt_deg: tuple[float, float] = (0.0, 0.0)
    camera_roll_deg: float = 0.0
    light_slope: tuple[float, float] = (0.0, 0.0)
    light_gain: float = 1.0
    height_mm: float = 0.0
    camera: str = 'fisheye'
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    focal_ratio: float = 1.0
    centre_shift_px: tuple[float, float] = (0.0, 0.0)
    pattern: str = 'spheres'
    pitch_mm: float = 2.0
    markers_thickness_mm: float = 0.0
    outline: str = ''
    dome_radius_mm: float = 0.0
    dot_mm: tuple[float, float] = (0.0, 0.0)
    sides: str = 'ignored'

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise ConfigurationError(
                    f'a gel has {name!r} {getattr(self, name)!r}, but it must be one of: {", ".join(choices)}'
                )
        for name, (low, high) in BOUNDS.items():
            value = getattr(self, name)
            if not all(low <= each <= high for each in (value if isinstance(value, tuple) else (value,))):
                raise ConfigurationError(f'a gel has {name!r} {value!r}, but it must be from {low:g} to {high:g}')
        try:
            self.dome.require_shallow(self.rim.farthest_mm)
        except ValueError as error:
            raise ConfigurationError(f'a gel cannot be simulated: {error}') from error
        flat = not (self.outline or self.dome_radius_mm)
        if self.sides != 'ignored' and not (flat and max(self.sides_mm) <= MOST_SLENDER * self.layer_mm):
            raise ConfigurationError(
                f'only a flat rectangular gel at most {MOST_SLENDER:g} times as wide as thick can have sides; set '
                "'sides' to ignored"
            )

    @property
    def rim(self) -> Outline:
        return Outline(*self.sides_mm, self.outline)

    @property
    def dome(self) -> Dome:
        return Dome(self.dome_radius_mm)

    @property
    def sides_mm(self) -> tuple[float, float]:
        """Width and height of the surface: (32, 32)."""
        return self.size_mm, self.height_mm or self.size_mm

    @property
    def layer_mm(self) -> float:
        """Thickness of the part that deforms: 6 mm."""
        return self.soft_mm + self.skin_mm

    @property
    def pupil_z_mm(self) -> float:
        """z of the camera's pupil in the surface frame: -23 mm."""
        return -(self.layer_mm + self.pupil_below_markers_mm)

    @property
    def gel_id(self) -> str:
        """Twelve hexadecimal digits that change with any property of the gel."""
        text = json.dumps(self._properties(LATER), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @property
    def card(self) -> dict[str, object]:
        """The description of the gel in data sets and models."""
        return {'id': self.gel_id, **self._properties(LEFT_OUT)}

    def _properties(self, unless_set: tuple[str, ...]) -> dict[str, object]:
        """All properties, except those of `unless_set` that have their default value."""
        first = {each.name: each.default for each in fields(self) if each.name in unless_set}
        return {name: value for name, value in asdict(self).items() if name not in first or value != first[name]}

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object], source: str = 'gel') -> Gel:
        """A gel with these properties, and the defaults for all others.

        Raises:
            ConfigurationError: an unknown property or one of the wrong type.
        """
        defaults = {each.name: each.default for each in fields(cls)}
        for name, value in mapping.items():
            if name not in defaults:
                raise ConfigurationError(f'{source}: a gel has no property {name!r}; it has: {", ".join(defaults)}')
            if not _same_kind(value, defaults[name]):
                raise ConfigurationError(f'{source}: {name!r} must be like {defaults[name]!r}, got {value!r}')
        given = {name: _like(defaults[name], value) for name, value in mapping.items()}
        return cls(**given)  # type: ignore[arg-type]


def _like(default: object, value: object) -> object:
    if isinstance(value, (list, tuple)):
        return tuple(float(each) for each in value)
    return float(value) if isinstance(default, float) else value  # type: ignore[arg-type]


def _same_kind(value: object, default: object) -> bool:
    if isinstance(value, bool):
        return False
    if isinstance(default, tuple):
        numbers = isinstance(value, (list, tuple)) and all(_same_kind(each, 0.0) for each in value)
        return numbers and len(value) == len(default)  # type: ignore[arg-type]
    return isinstance(value, (int, float) if isinstance(default, float) else type(default))
