"""Motion of image regions under forces on the gel, by rays through its depth.

A region of the image sees a column of markers along its rays. Its motion under a load is the mean, over the rays of its
window and over depths, of the layer's displacement as the camera projects it. The depths of its own markers and the
exact paths of its rays are unknown. So its response is a sum of terms: at each of five depths the displacement, and its
derivatives along x and y. Before a calibration the derivatives have weight 0, and the weights of the depths decrease
with the distance from the pupil (`nominal_shares`).

Printed dots show the motion only at their own places. So a region of dots moves as the flow method `dots` interpolates
it from the dots: the terms of each dot are computed, and added in the way in which the flow adds motions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_nodes.sensing.elasticity.fields import FINER, combed, fields_of, sampled_at, seen_by_rays
from tactile_nodes.sensing.elasticity.layer import WIDTH_MM, ElasticLayer
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.elasticity.rays import ALONG, Rays, described_dots, of_dots, of_windows
from tactile_nodes.sensing.elasticity.sides import Sides, seen, sides_of
from tactile_nodes.sensing.elasticity.stack import Elastic
from tactile_nodes.sensing.elasticity.view import DEPTHS, View
from tactile_nodes.sensing.flow.dots import weights_of_dots
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Bool, Float, Float32, Inexact, Int

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

TERMS = 3 * DEPTHS
"""Terms of each region: at each depth the displacement, and its derivatives along x and along y."""

WINDOW = 1.2
"""Side of the window from which a region's motion is measured, over the side of the region."""

NEAR = 2
"""Patches to either side that move with the shear on a patch."""

BRIGHTNESS = -2.0
"""Exponent of the distance from the pupil in the weight of markers, that of the area of their images. With it seven
simulated gels are read 1 % off, with the fourth power 6 %."""

THICKNESSES = 4
"""Number of thicknesses at which a dome's layer is solved: in the middle, at its rim, and between."""

SLOPE_STEP_MM = 0.5
"""Step for the slopes of what sides add, which is smooth."""


class Fields(NamedTuple):
    """Displacements under a pressure of 1 N around each of some places, whatever the camera.

    `layers` holds them for each thickness of the layer, from `fields_of`; `by_sides_mm` what sides add at each place.
    """

    places_mm: Float[np.ndarray, 'presses 2']
    layers: list[Float32[np.ndarray, 'depths 3 loads sets y x']]
    by_sides_mm: Float32[np.ndarray, 'unknowns presses'] | None


LOADS = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
"""Loads as columns: into the gel, along x, along y."""


LEAST_INSIDE = 0.1
"""Least share of a region's rays that must end within the gel; regions at the rim see past it."""


@dataclass(frozen=True)
class Regions:
    """The regions of a sensor's image: `rows` by `cols` over the crop."""

    sensor: Sensor
    rows: int
    cols: int

    @property
    def count(self) -> int:
        return self.rows * self.cols

    @property
    def bins(self) -> BinGrid:
        """The bins on which the sensor reports forces."""
        return BinGrid.of_sensor(self.sensor)

    @property
    def patches(self) -> PatchGrid:
        """The patches on which forces are solved for."""
        return PatchGrid(self.bins)

    @cached_property
    def view(self) -> View:
        """The camera and the gel."""
        return View(self.sensor)

    @cached_property
    def _windows(self) -> Rays:
        return of_windows(self.view, (self.rows, self.cols), WINDOW)

    @cached_property
    def rays(self) -> Rays:
        """Rays of the windows of the regions, or of the printed dots."""
        return of_dots(self.view) if self.dotted else self._windows

    @property
    def dotted(self) -> bool:
        """Whether the regions show printed dots."""
        return self.sensor.pattern.kind == 'dots'

    @cached_property
    def _dot_weights(self) -> Float32[np.ndarray, 'regions dots']:
        """Weight of each dot's motion in each region."""
        pitch_px = self.view.px_per_mm * self.sensor.pattern.pitch_mm
        shape = self.rows, self.cols
        weights = weights_of_dots(described_dots(self.view), pitch_px, self.sensor.image.crop_px, shape)
        return np.asarray(weights, np.float32)

    @cached_property
    def layer(self) -> ElasticLayer:
        """The gel at the depths of its markers, on a grid that patches divide."""
        return self._layer_at(self.view.depths_mm)

    @cached_property
    def surface(self) -> ElasticLayer:
        """The gel at its surface, on the same grid."""
        return self._layer_at(np.zeros(1))

    @property
    def surface_under_shear(self) -> Float32[np.ndarray, '2 near near']:
        """Motion of the surface [mm] along x under 1 N along x on a patch, at the patch and those around it; likewise
        along y."""
        kernels = self.surface.kernels(self.surface.rectangle(*self.patches.size_mm))
        beside = FINER * np.arange(-NEAR, NEAR + 1)
        cols, rows = ((cells // 2 + beside) % cells for cells in self.surface.cells)  # the layer repeats
        return np.ascontiguousarray(np.stack([kernels[0, 0, 1], kernels[0, 1, 2]])[:, rows[:, None], cols])

    @cached_property
    def _layers(self) -> tuple[tuple[float, ElasticLayer], ...]:
        """The layers of the gel, with how much thinner [mm] each is than in the middle; a flat gel has one layer."""
        if not self.sensor.gel.dome_radius_mm:
            return ((0.0, self.layer),)
        thinner = np.linspace(0, self.sensor.gel.sag_mm, THICKNESSES).tolist()
        return tuple((each, self._layer_at(self.view.depths_mm, each)) for each in thinner)

    def _as_thick(self, places_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'layers n']:
        """Weight of each of these layers at places of the surface."""
        thinner = [each for each, _ in self._layers]
        sag = -self.sensor.gel.dome.height_mm(places_mm)
        return np.array([np.interp(sag, thinner, one) for one in np.eye(len(thinner))])

    def _layer_at(self, depths_mm: Float[np.ndarray, ' depths'], thinner_mm: float = 0.0) -> ElasticLayer:
        gel, stack = self.sensor.gel, self._stack(thinner_mm)
        width, height = self.patches.size_mm
        repeated_mm = max(WIDTH_MM, 2 * gel.width_mm, 2 * gel.height_mm)
        return ElasticLayer(stack, depths_mm, (width / FINER, height / FINER), repeated_mm)

    def _stack(self, thinner_mm: float = 0.0) -> tuple[Elastic, ...]:
        gel = self.sensor.gel
        thick_mm = *gel.layers_mm[:-1], gel.layers_mm[-1] - thinner_mm
        return tuple(Elastic(*each) for each in zip(thick_mm, gel.moduli_mpa, gel.poisson_ratios, strict=True))

    @property
    def sides(self) -> Sides | None:
        """The sides of the gel; None if they are ignored."""
        gel = self.sensor.gel
        if gel.sides == 'ignored':
            return None
        return sides_of(self._stack(), (gel.width_mm, gel.height_mm), self.patches, held=gel.sides == 'held')

    @property
    def nominal_shares(self) -> Float[np.ndarray, ' terms']:
        """Weights of the terms for an unknown region: depths by the visibility of their markers."""
        away = np.abs(-self.view.depths_mm - self.sensor.camera.position_mm[2])
        shares = np.zeros((DEPTHS, 3))
        shares[:, 0] = away**BRIGHTNESS / (away**BRIGHTNESS).sum()
        return shares.reshape(-1)

    @cached_property
    def _px_per_mm(self) -> Float[np.ndarray, 'depths parts rays 2 3']:
        """`Rays.px_per_mm`, but 0 beyond the rim of a rectangular gel, where no markers are.

        The rays within the rim count the more. If those are less than `LEAST_INSIDE`, the region hardly sees the gel.
        Dots lie within the rim, and so does what `usable` regions of a gel of another shape see.
        """
        gel = self.sensor.gel
        if self.dotted or gel.outline_mm:
            return self.rays.px_per_mm
        depth_mm = (np.array([gel.width_mm, gel.height_mm]) / 2 - np.abs(self.rays.points_mm[..., :2])).min(axis=-1)
        inside = np.clip(depth_mm / (self._window_mm / ALONG) + 0.5, 0.0, 1.0)
        share = (self.nominal_shares[::3] @ inside.mean(axis=-1))[:, None]
        return np.asarray(self.rays.px_per_mm * (inside / np.maximum(share, LEAST_INSIDE))[..., None, None])

    @property
    def _window_mm(self) -> float:
        return WINDOW * self.sensor.image.crop_px[0] / self.cols / self.view.px_per_mm

    @property
    def near(self) -> bool:
        """Whether markers lie near the surface, where they show details smaller than a bin: in the upper quarter.

        The paper's lie 3.75 mm deep in 6 mm, those of `9dtact_like` 0.65 mm deep in 4 mm.
        """
        return self.view.middle_mm < sum(self.sensor.gel.layers_mm) / 4

    @property
    def within_gel(self) -> Bool[np.ndarray, ' regions']:
        """Which regions see only the gel, at every visible depth."""
        return np.asarray(self.sensor.gel.outline.holds(self._windows.points_mm[..., :2]).all(axis=(0, 2)))

    @property
    def covered(self) -> Bool[np.ndarray, ' regions']:
        """Which regions have a window that the mask covers in part."""
        covered, (width, height) = self.sensor.covered, self.sensor.image.crop_px
        found = np.zeros((self.rows, self.cols), bool)
        if covered.any():
            for row, col in np.ndindex(self.rows, self.cols):
                down, across = (
                    slice(max(0, math.floor(low)), math.ceil(low + WINDOW * side))
                    for low, side in (
                        ((at + 0.5 - WINDOW / 2) * side, side)
                        for at, side in ((row, height / self.rows), (col, width / self.cols))
                    )
                )
                found[row, col] = covered[down, across].any()
        return found.ravel()

    @property
    def usable(self) -> Bool[np.ndarray, ' regions']:
        """Which regions see only the gel."""
        usable: np.ndarray = self.within_gel & ~self.covered
        return usable

    def terms_of_patches(
        self, known: Int[np.ndarray, ' known'], *, slopes: bool = True
    ) -> Float32[np.ndarray, 'known 2 terms unknowns']:
        """Motion [px] of some regions by term under 1 N on each patch; without `slopes` by depth only.

        Unknowns are all normal forces, then those along x, then those along y. The motion is zero for patches whose
        centre is outside the gel.
        """
        if not self.dotted:
            return self._patches_on_parts(known, slopes)
        terms = self._patches_on_parts(np.arange(len(self.rays)), slopes)
        return np.asarray(np.tensordot(self._dot_weights[known], terms, axes=1))

    def _patches_on_parts(
        self, parts: Int[np.ndarray, ' n'], slopes: bool
    ) -> Float32[np.ndarray, 'n 2 terms unknowns']:
        """The same of windows, or dots."""
        patches = self.patches
        if not self.sensor.gel.dome_radius_mm:
            split = self._terms_in(self.layer, parts, slopes)
            if sides := self.sides:
                by_sides = self._by_sides(sides.added_mm, parts, slopes)
                split += by_sides.reshape(*split.shape[:3], -1, 3, patches.count).swapaxes(3, 4)
        else:
            shares = self._as_thick(patches.centres_mm).astype(np.float32)
            split = sum(
                share * self._terms_in(layer, parts, slopes)
                for share, (_, layer) in zip(shares, self._layers, strict=True)
            )
            split = np.einsum('rdplsc,clm->rdpmsc', split, self._loads_at(patches.centres_mm), optimize=True)
        split[..., ~self.sensor.gel.outline.holds(patches.centres_mm)] = 0
        ordered: np.ndarray = split.transpose(0, 2, 1, 4, 3, 5).reshape(len(parts), 2, -1, 3 * patches.count)
        return ordered

    def _loads_at(self, places_mm: Float[np.ndarray, 'n 2']) -> Float32[np.ndarray, 'n 3 3']:
        """Components of forces into the gel, along x and along y in the tilted frame of the surface at places."""
        leaning = self.sensor.gel.dome.axes(places_mm) @ LOADS
        return np.asarray(leaning.swapaxes(-1, -2) @ LOADS, np.float32)

    def _terms_in(
        self, layer: ElasticLayer, parts: Int[np.ndarray, ' n'], slopes: bool
    ) -> Float32[np.ndarray, 'n depths 2 loads sets patches']:
        """The same in a flat layer, with forces in the frame of its surface."""
        patches = self.patches
        fields = fields_of(layer, layer.rectangle(*patches.size_mm), slopes=slopes)
        (rows, cols), jacobian = patches.shape, (self._px_per_mm[:, parts] / ALONG**2).astype(np.float32)
        node, rest = (each[:, parts] for each in self._last_patch(patches))
        terms = np.zeros((len(parts), DEPTHS, 2, 3 * fields.shape[3] * patches.count), np.float32)
        for depth in range(DEPTHS):
            combs = combed(fields[depth], (rows, cols))
            for part in range(len(parts)):
                where = node[depth, part], rest[depth, part], jacobian[depth, part]
                terms[part, depth] = seen_by_rays(combs, *where, (rows, cols)).reshape(2, -1)
        return terms.reshape(len(parts), DEPTHS, 2, 3, -1, patches.count)

    def _last_patch(self, patches: PatchGrid) -> tuple[np.ndarray, np.ndarray]:
        """Node of the layer's grid below a ray, relative to the last patch, and the remaining fraction of a step."""
        last = np.array([each[-1] for each in patches.lines_mm])
        middle = np.array(self.layer.cells) // 2
        steps = (self.rays.points_mm[..., :2] - last) / np.asarray(self.layer.spacing_mm) + middle
        node = np.floor(steps)
        rest: np.ndarray = steps - node
        return node.astype(int), rest.astype(np.float32)

    def terms_of_pressure(
        self,
        places_mm: Float[np.ndarray, 'presses 2'],
        spectrum: Inexact[np.ndarray, 'ky kx'],
        known: Int[np.ndarray, ' known'],
    ) -> Float32[np.ndarray, 'presses known 2 terms']:
        """Motion [px] of some regions by term under 1 N of a pressure around each place; its spectrum comes from
        `ElasticLayer.points`."""
        if not self.dotted:
            return self._pressure_on_parts(places_mm, spectrum, known)
        terms = self._pressure_on_parts(places_mm, spectrum, np.arange(len(self.rays)))
        in_regions: np.ndarray = np.einsum('rd,nd...->nr...', self._dot_weights[known], terms)
        return in_regions

    def terms_by_sides(self, known: Int[np.ndarray, ' known']) -> Float32[np.ndarray, 'known 2 terms patches'] | None:
        """What the sides of the gel add to the motion [px] of some regions by term, under 1 N into the gel on each
        patch; None if they are ignored."""
        if (sides := self.sides) is None:
            return None
        parts = np.arange(len(self.rays)) if self.dotted else known
        found = self._by_sides(sides.pressed_mm, parts, True)
        terms = found.swapaxes(1, 2).reshape(len(parts), 2, TERMS, -1)
        return np.asarray(np.tensordot(self._dot_weights[known], terms, axes=1)) if self.dotted else terms

    def fields_under(
        self, places_mm: Float[np.ndarray, 'presses 2'], spectrum: Inexact[np.ndarray, 'ky kx'], *, slopes: bool = True
    ) -> Fields:
        """Displacements in the gel under a pressure around each place, independent of the camera."""
        domed, by_sides = self.sensor.gel.dome_radius_mm > 0, None
        layers = [fields_of(layer, spectrum, pressed_only=not domed, slopes=slopes) for _, layer in self._layers]
        if sides := self.sides:
            about, force_n = self.layer.forces(spectrum)
            forces = np.stack([sides.on_patches(place + about, force_n) for place in places_mm], -1)
            by_sides = sides.pressed_mm @ forces.astype(np.float32)
        return Fields(places_mm, layers, by_sides)

    def motion_as_described(self, fields: Fields, known: Int[np.ndarray, ' known']) -> Float32[np.ndarray, 'n known 2']:
        """Motion [px] of some windows under 1 N around each of n places, with depths weighted by `nominal_shares`;
        `fields` without slopes."""
        terms = self._seen_in(fields, known)
        return np.asarray(terms[..., 0] @ self.nominal_shares[::3].astype(np.float32))

    def _pressure_on_parts(
        self, places_mm: Float[np.ndarray, 'presses 2'], spectrum: Inexact[np.ndarray, 'ky kx'], parts: np.ndarray
    ) -> Float32[np.ndarray, 'presses n 2 terms']:
        """The same of windows, or dots."""
        found = self._seen_in(self.fields_under(places_mm, spectrum), parts)
        return found.reshape(len(places_mm), len(parts), 2, TERMS)

    def _seen_in(self, under: Fields, parts: np.ndarray) -> Float32[np.ndarray, 'presses n 2 depths sets']:
        places_mm, in_layers, by_sides_mm = under
        domed, sets = self.sensor.gel.dome_radius_mm > 0, in_layers[0].shape[3]
        shares, loads = self._as_thick(places_mm), self._loads_at(places_mm)[..., 0]
        points, jacobian = self.rays.points_mm[:, parts, :, :2], self._px_per_mm[:, parts] / ALONG**2
        levers = jacobian.astype(np.float32).swapaxes(2, 3).reshape(DEPTHS, len(parts), 2, -1)
        found = np.zeros((len(places_mm), len(parts), 2, DEPTHS, sets), np.float32)
        for number, place in enumerate(places_mm):
            fields = in_layers[0][:, :, 0]
            if domed:
                there = sum(share * each for share, each in zip(shares[:, number], in_layers, strict=True))
                fields = np.einsum('dclsyx,l->dcsyx', there, loads[number])
            at = (points - place) / np.asarray(self.layer.spacing_mm) + np.array(self.layer.cells) // 2
            for depth in range(DEPTHS):
                sampled = sampled_at(fields[depth].reshape(3 * sets, *fields.shape[-2:]), at[depth])
                by_ray = sampled.reshape(3, sets, len(parts), -1).transpose(2, 3, 0, 1).reshape(len(parts), -1, sets)
                found[number, :, :, depth] = levers[depth] @ by_ray
        if by_sides_mm is not None:
            found += self._by_sides(by_sides_mm, parts, sets > 1).transpose(4, 0, 2, 1, 3)
        return found

    def _by_sides(
        self, added: Float32[np.ndarray, 'unknowns loads'], parts: np.ndarray, slopes: bool
    ) -> Float32[np.ndarray, 'n depths 2 sets loads']:
        """Motion of windows or dots by term, from displacements that the sides add."""
        found = np.empty((len(parts), DEPTHS, 2, 3 if slopes else 1, added.shape[1]), np.float32)
        steps = SLOPE_STEP_MM * np.eye(3)[:2]

        def moved(nodes: csr_matrix) -> np.ndarray:
            return np.asarray((nodes @ added).reshape(len(self.rays), 2, -1)[parts])

        for depth in range(DEPTHS):
            found[:, depth, :, 0] = moved(self._nodes_of_sides[depth])
            for number, step in enumerate(steps if slopes else (), 1):
                ahead, behind = (moved(self._nodes_at(depth, each)) for each in (step, -step))
                found[:, depth, :, number] = (ahead - behind) / (2 * SLOPE_STEP_MM)
        return found

    @cached_property
    def _nodes_of_sides(self) -> list[csr_matrix]:
        """For each depth the matrix from displacements of the nodes of `sides` to motion of windows or dots."""
        return [self._nodes_at(depth, np.zeros(3)) for depth in range(DEPTHS)]

    def _nodes_at(self, depth: int, by_mm: Float[np.ndarray, ' 3']) -> csr_matrix:
        """The same for one depth, with all points moved by `by_mm`."""
        assert self.sides is not None
        return seen(self.sides.lines_mm, self.rays.points_mm[depth] + by_mm, self._px_per_mm[depth] / ALONG**2)
