"""The camera image: markers in the gel, moved by the contact, seen through a lens, with noise.

A marker is a disc of light blurred by lens and pixel. It is drawn as a normalised Gaussian of the same variance at
its exact sub-pixel position, so that its centroid moves exactly as the marker does. Overlapping markers add up.
Refraction, shadows and the skin's own grey are not modelled.

Markers that move during the exposure are drawn at two moments, which gives the motion blur its true mean and spread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Float32, UInt8
from tactile_nodes.simulation.camera import camera_of, camera_turn, pupil, shade, through_jpeg
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.markers import domed, place_markers
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.shear import ShearTable, shear_of
from tactile_nodes.simulation.sides import MovedBySides
from tactile_nodes.simulation.touch.table import Placed, Touch, TouchTable, node_forces

TAPS = np.arange(-3, 5)
"""Pixels that receive the light of a marker: from three left of its pixel to four right of it."""

LEAST_SMEAR_PX = 0.01
"""Markers that stay this close to their mean position during an exposure are drawn there: a motion of this size
increases a dot's variance of 0.6 px² by 1e-4 px²."""


@dataclass(frozen=True)
class Press:
    """One indenter at a place on the surface, pressed in by a depth (negative: height above the gel).

    `x_mm`, `y_mm` is where it first touched; `shift_mm` is how far it was dragged since, sticking to the gel.
    """

    x_mm: float
    y_mm: float
    depth_mm: float
    indenter: str = 'tip'
    shift_mm: tuple[float, float] = (0.0, 0.0)

    @property
    def touching(self) -> bool:
        return self.depth_mm > 0


Shaping = Press | Touch
"""What deforms a gel: a round tip with an axisymmetric table, or a body of any shape on its path."""

PLACES_KEPT = 4

LARGEST_VARIANCE_PX2 = 1.0
"""Largest variance of a marker's disc: a wider one does not fit into the pixels that receive its light."""


class Optics:
    """Renders one gel. The same presses and noise seed give the same pixels, in any process, in any order."""

    def __init__(
        self,
        gel: Gel,
        table: ContactTable,
        others: Mapping[str, ContactTable] | None = None,
        bodies: Mapping[str, TouchTable] | None = None,
    ) -> None:
        """Takes tables of the gel's own tip, of other indenters that presses name, and of bodies that touches name."""
        self._gel = gel
        self._tables = {'tip': table, **(others or {})}
        self._bodies, self._placed = dict(bodies or {}), dict[Touch, Placed]()
        self._over: Touch | None = None
        self._shear: dict[str, ShearTable] = {}
        self.camera = camera_of(gel)
        self._turn = camera_turn(gel)
        self._flat_mm, diameter_mm = place_markers(gel)
        self.markers_mm, self._leaning = domed(gel, self._flat_mm)
        distance = np.linalg.norm(self.markers_mm - pupil(gel), axis=1)
        radius_px = gel.focal_px_per_rad * diameter_mm / 2 / distance
        # The variance of a disc is a quarter of its squared radius along each axis, that of a pixel 1/12.
        variance = np.minimum(radius_px**2 / 4, LARGEST_VARIANCE_PX2) + gel.blur_px**2 + 1 / 12
        self._exponent = (-0.5 / variance).astype(np.float32)
        self._light = (gel.marker_grey * np.pi * radius_px**2).astype(np.float32)
        self._shade = shade(gel)
        self._noise = NoiseBank(gel)
        self._by_sides = None if gel.sides == 'ignored' else MovedBySides(gel, self._flat_mm)
        self._lookups = {name: TableLookup(each, self._flat_mm[:, 2]) for name, each in self._tables.items()}
        self._rest = self._draw(self.project(()))
        self._last: tuple[tuple[Shaping, ...], np.ndarray] = (), self._rest

    def displacement_mm(self, presses: tuple[Shaping, ...]) -> Float32[np.ndarray, 'markers 3']:
        """How far each marker moves; the fields of several presses add up."""
        moved = np.zeros_like(self.markers_mm)
        for press in presses:
            if press.touching:
                moved += self._touched(press) if isinstance(press, Touch) else self._field(press)
        return moved if self._leaning is None else np.einsum('mab,mb->ma', self._leaning, moved)

    def _touched(self, touch: Touch) -> Float32[np.ndarray, 'markers 3']:
        """Displacement of the markers by a body."""
        moved = self._placed_at(touch).moved_mm(touch.stage)
        return moved if self._by_sides is None else moved + self._by_body(touch)

    def _by_body(self, touch: Touch) -> Float32[np.ndarray, 'markers 3']:
        """What the sides add to it, solved at each stage of the table and linear between them."""
        table = self._bodies[touch.body]
        low = min(int(touch.stage), table.stages - 2)
        one, other = (self._sides_under(replace(touch, stage=float(stage))) for stage in (low, low + 1))
        return np.asarray(one + np.float32(touch.stage - low) * (other - one))

    def _sides_under(self, touch: Touch) -> Float32[np.ndarray, 'markers 3']:
        assert self._by_sides is not None

        def forces() -> tuple[np.ndarray, np.ndarray]:
            place_mm, force = node_forces(self._bodies[touch.body], touch)
            return place_mm, self._gel.shear_modulus_mpa * force[:, :, None] * [[1.0], [1.0], [-1.0]]

        return self._by_sides.moved_mm(touch, forces)[..., 0]

    def _placed_at(self, touch: Touch) -> Placed:
        """The table of a body evaluated at the markers, cached for the last few places."""
        if touch.body not in self._bodies:
            known = ', '.join(self._bodies) or 'none'
            raise ConfigurationError(f'no contact table was given for the body {touch.body!r}; there are: {known}')
        place = replace(touch, stage=0.0)
        if place not in self._placed:
            while len(self._placed) >= PLACES_KEPT:
                del self._placed[next(iter(self._placed))]
            self._placed[place] = Placed(self._bodies[touch.body], self._flat_mm, place)
        return self._placed[place]

    def _come_near(self, presses: tuple[Shaping, ...]) -> None:
        """Prepare the table of a body that stays above a place, before it touches there."""
        for touch in presses:
            if isinstance(touch, Touch):
                if touch == self._over:
                    self._placed_at(touch)
                self._over = touch

    def _field(self, press: Press) -> Float32[np.ndarray, 'markers 3']:
        if press.indenter not in self._lookups:
            known = ', '.join(self._lookups)
            raise ConfigurationError(
                f'no contact table was given for the indenter {press.indenter!r}; there are: {known}'
            )
        field: np.ndarray = self._lookups[press.indenter](self._flat_mm, press)
        if any(press.shift_mm):
            field = field + self._drag(press)
        return field if self._by_sides is None else field + self._by_tip(press)

    def _by_tip(self, press: Press) -> Float32[np.ndarray, 'markers 3']:
        """What the sides add to it: in proportion to its force."""
        assert self._by_sides is not None
        place = press.x_mm, press.y_mm
        per_n = self._by_sides.moved_mm(place, lambda: (np.array([place]), np.eye(3)[None]))
        drag_n = self.drag_n(press) if any(press.shift_mm) else (0.0, 0.0)
        force_n = np.array([*drag_n, -self._tables[press.indenter].force_at(press.depth_mm)], np.float32)
        return np.asarray(per_n @ force_n)

    def _drag(self, press: Press) -> Float32[np.ndarray, 'markers 3']:
        """Displacement added by dragging a sticking tip."""
        table, contact_mm = self._dragged(press)
        offset = self._flat_mm - np.array([press.x_mm, press.y_mm, 0], np.float32)
        return table.displacement_mm(contact_mm, offset, press.shift_mm)

    def drag_n(self, press: Press) -> tuple[float, float]:
        """Force of a dragged, sticking tip on the gel along x and y."""
        table, contact_mm = self._dragged(press)
        return table.force_n(contact_mm, press.shift_mm)

    def _dragged(self, press: Press) -> tuple[ShearTable, float]:
        """The shear table of a press, and its contact radius."""
        table = self._tables[press.indenter]
        if press.indenter not in self._shear:
            self._shear[press.indenter] = shear_of(self._gel, table)
        return self._shear[press.indenter], table.contact_at(press.depth_mm)

    def project(self, presses: tuple[Shaping, ...]) -> Float32[np.ndarray, 'markers 2']:
        """Pixel position of each marker in the camera image."""
        seen = self.markers_mm + self.displacement_mm(presses) - pupil(self._gel)
        return self.camera.project(seen if self._turn is None else seen @ self._turn)

    def radiance(self, presses: tuple[Shaping, ...]) -> Float32[np.ndarray, 'h w']:
        """The image in grey levels before noise and rounding."""
        if not any(press.touching for press in presses):
            self._come_near(presses)
            return self._rest
        last, drawn = self._last
        if presses != last:  # while a tip rests, only the noise changes
            drawn = self._draw(self.project(presses))
            self._last = presses, drawn
        return drawn

    def render(self, presses: tuple[Shaping, ...], noise_seed: int) -> UInt8[np.ndarray, 'h w']:
        """The image as the camera delivers it."""
        return self.expose((presses,), noise_seed)

    def expose(self, moments: Sequence[tuple[Shaping, ...]], noise_seed: int) -> UInt8[np.ndarray, 'h w']:
        """The image as the camera delivers it, exposed over the given moments."""
        different = tuple(dict.fromkeys(moments))
        radiance = self.radiance(different[0]) if len(different) == 1 else self._smeared(different)
        image = self._noise.expose(radiance, noise_seed)
        return through_jpeg(image, self._gel.jpeg_quality) if self._gel.jpeg_quality else image

    def _smeared(self, moments: tuple[tuple[Shaping, ...], ...]) -> Float32[np.ndarray, 'h w']:
        """The mean over some moments; only markers with noticeable motion are drawn at each of them."""
        pixels = np.stack([self.project(each) for each in moments])
        middle = pixels.mean(axis=0)
        moving = np.flatnonzero((np.abs(pixels - middle) > LEAST_SMEAR_PX).any(axis=(0, 2)))
        still = np.delete(np.arange(len(middle)), moving)
        # Moving markers are drawn at each moment with its share of the light, in addition to all others.
        which = np.concatenate([still, np.tile(moving, len(moments))])
        places = np.concatenate([middle[still], pixels[:, moving].reshape(-1, 2)])
        share = np.repeat([1, 1 / len(moments)], [len(still), len(which) - len(still)]).astype(np.float32)
        return self._draw(places, which, self._light[which] * share)

    def _draw(
        self, pixels: np.ndarray, which: np.ndarray | slice = slice(None), light: np.ndarray | None = None
    ) -> np.ndarray:
        """Radiance of markers at positions: of all markers, or of those given, optionally with another brightness."""
        height, width = self._shade.shape
        rim = len(TAPS) - 1  # beyond the image, for the parts of markers at its border that are not seen
        high, wide = height + 2 * rim, width + 2 * rim
        corner = np.floor(pixels)
        part = pixels - corner
        across, down = (self._weights(part[:, axis], self._exponent[which]) for axis in (0, 1))
        down *= (self._light if light is None else light)[:, None]
        spread = (down[:, :, None] * across[:, None, :]).reshape(len(pixels), -1)
        first = (corner[:, 1].astype(np.intp) + rim) * wide + corner[:, 0].astype(np.intp) + rim
        place = first[:, None] + (TAPS[:, None] * wide + TAPS).ravel()
        inside = ((corner >= -TAPS[-1]) & (corner < (width - TAPS[0], height - TAPS[0]))).all(axis=1)
        if not inside.all():
            place, spread = place[inside], spread[inside]
        sums = np.bincount(place.ravel(), weights=spread.ravel(), minlength=high * wide)
        drawn: np.ndarray = sums.reshape(high, wide)[rim:-rim, rim:-rim].astype(np.float32)
        drawn += np.float32(self._gel.background_grey)
        drawn *= self._shade
        if self._gel.marker_grey < 0:  # overlapping dark markers cannot make the light negative
            np.maximum(drawn, 0, out=drawn)
        return drawn

    @staticmethod
    def _weights(part: np.ndarray, exponent: np.ndarray) -> np.ndarray:
        offset = TAPS.astype(np.float32) - part[:, None]
        weights: np.ndarray = np.exp(offset * offset * exponent[:, None])
        weights /= weights.sum(axis=1, keepdims=True)
        return weights


class TableLookup:
    """Displacement of fixed points from a table: linear between its radii, heights and depths."""

    def __init__(self, table: ContactTable, z_mm: Float32[np.ndarray, ' points']) -> None:
        self._table = table
        self._per_mm = np.float32(1 / (table.radius_mm[1] - table.radius_mm[0]))
        place = (z_mm - table.z_mm[0]) / (table.z_mm[1] - table.z_mm[0])
        self._low = np.clip(place.astype(np.intp), 0, len(table.z_mm) - 2)
        self._part = (place - self._low).astype(np.float32)

    def __call__(self, points_mm: Float32[np.ndarray, 'points 3'], press: Press) -> Float32[np.ndarray, 'points 3']:
        """Displacement of the points; their heights must be those given at construction. Zero beyond the table."""
        centre = np.array([press.x_mm, press.y_mm], np.float32)
        offset = points_mm[:, :2] - centre
        distance = np.sqrt(np.square(offset).sum(axis=1))
        place = np.minimum(distance * self._per_mm, np.float32(len(self._table.radius_mm) - 1.001))
        low = place.astype(np.intp)
        outward, upward = (self._blend(each, low, place - low) for each in self._table.displacement_at(press.depth_mm))
        outward /= np.maximum(distance, np.float32(1e-6))
        return np.column_stack([offset * outward[:, None], upward])

    def _blend(self, values: np.ndarray, low: np.ndarray, part: np.ndarray) -> np.ndarray:
        columns = values.shape[1]
        flat = values.ravel()
        corner = low * columns + self._low
        part = part.astype(np.float32)
        near = flat[corner] + self._part * (flat[corner + 1] - flat[corner])
        corner += columns
        far = flat[corner] + self._part * (flat[corner + 1] - flat[corner])
        blended: np.ndarray = near + part * (far - near)
        return blended


class NoiseBank:
    """Read and shot noise: one large field of normal deviates, with a different crop for every seed.

    Drawing 307200 normal deviates takes longer than rendering. A crop at one of 256x256 places of a prepared field
    costs nothing, and two frames share a crop once in 65536.
    """

    ROOM = 256

    def __init__(self, gel: Gel) -> None:
        self._shape = gel.image_height, gel.image_width
        self._shot = np.float32(gel.shot_noise_grey)
        self._read_variance = np.float32(gel.read_noise_grey**2)
        size = (gel.image_height + self.ROOM, gel.image_width + self.ROOM)
        self._field = np.random.default_rng(gel.seed).standard_normal(size, dtype=np.float32)

    def expose(self, radiance: Float32[np.ndarray, 'h w'], seed: int) -> UInt8[np.ndarray, 'h w']:
        """Grey levels with noise, rounded and limited to 0 to 255.

        The variance is read² + shot * grey: 1.2 and 0.05 give 1.39 grey levels at 10 and 2.99 at 150.
        """
        y, x = divmod(mix(seed) % self.ROOM**2, self.ROOM)
        noise = self._field[y : y + self._shape[0], x : x + self._shape[1]]
        spread = self._spread(radiance)
        np.sqrt(spread, out=spread)
        spread *= noise
        spread += radiance
        spread += np.float32(0.5)  # the conversion to integers truncates
        np.clip(spread, 0, 255, out=spread)
        image: np.ndarray = spread.astype(np.uint8)
        return image

    def variance(self, radiance: Float32[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
        """Variance of the grey levels from `expose`: that of the noise, and 1/12 for rounding."""
        variance: np.ndarray = self._spread(radiance) + np.float32(1 / 12)
        return variance

    def _spread(self, radiance: Float32[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
        spread: np.ndarray = radiance * self._shot
        spread += self._read_variance
        return spread


def mix(value: int) -> int:
    """A well-spread 64 bit number from any integer (splitmix64), the same on every machine."""
    mask = 0xFFFF_FFFF_FFFF_FFFF
    value = (value + 0x9E37_79B9_7F4A_7C15) & mask
    value = ((value ^ (value >> 30)) * 0xBF58_476D_1CE4_E5B9) & mask
    value = ((value ^ (value >> 27)) * 0x94D0_49BB_1331_11EB) & mask
    return value ^ (value >> 31)
