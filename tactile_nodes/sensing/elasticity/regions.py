"""What regions of the picture see of a gel that moves: rays through its depth, and the motion in pixels along them.

A region of the image sees a column of markers along its rays. Its motion under a load is the mean, over the rays of its
window and over depths, of what the camera makes of the layer's displacement there. Nobody knows at which depths its own
markers lie, nor exactly where its rays meet the gel, so its response is a sum of terms: at each of five depths the
displacement, and its slopes along x and y. What each term counts is 0 for slopes, and for depths it falls with the
distance from the pupil, until presses say better (`nominal_shares`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Inexact, Int

from tactile_nodes.sensing.elasticity.fields import FINER, between, combed, fields_of, sampled_at
from tactile_nodes.sensing.elasticity.layer import WIDTH_MM, ElasticLayer
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.elasticity.stack import Elastic
from tactile_nodes.sensing.geometry import BinGrid, Camera, FisheyeCamera, PinholeCamera, rotation
from tactile_nodes.sensors import Sensor

DEPTHS = 5
TERMS = 3 * DEPTHS
"""Of each region: at each depth the displacement, and its slopes along x and along y."""

RAYS = 3
"""Along each side of a region's window."""

WINDOW = 1.2
"""Sides of a region that the window has from which its motion is measured."""

NEAR = 2
"""Patches to either side of one that its shear takes along."""

BRIGHTNESS = -2.0
"""Power of the distance from the pupil with which the weight of markers falls, as the area of their pictures does.
Seven simulated gels are read 1 % off with it, with the fourth power 6 %."""

DISPLACEMENT_MM = 1e-3

THICKNESSES = 4
"""Of a dome: the layer is solved so thick as it is in the middle, at its rim, and between."""

MEETING = 12
"""Steps in which a ray is found to meet a dome."""

LOADS = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
"""Into the gel, along x, along y: a column each."""


@dataclass(frozen=True)
class Regions:
    """The regions of a sensor's picture, `rows` by `cols` over what is cut from its middle."""

    sensor: Sensor
    rows: int
    cols: int

    @property
    def count(self) -> int:
        return self.rows * self.cols

    @property
    def bins(self) -> BinGrid:
        """The bins that the sensor tells forces on."""
        return BinGrid.of_sensor(self.sensor)

    @property
    def patches(self) -> PatchGrid:
        """The patches on which forces are solved for."""
        return PatchGrid(self.bins)

    @property
    def depths_mm(self) -> Float[np.ndarray, ' depths']:
        """Middles of five equal parts of what is visible, from the surface down."""
        high, low = self.sensor.gel.markers_mm
        return np.asarray(high + (np.arange(DEPTHS) + 0.5) * (low - high) / DEPTHS)

    @cached_property
    def layer(self) -> ElasticLayer:
        """The gel where its markers are, on a grid that patches divide."""
        return self._layer_at(self.depths_mm)

    @cached_property
    def surface(self) -> ElasticLayer:
        """The gel where bodies touch it, on the same grid."""
        return self._layer_at(np.zeros(1))

    @property
    def surface_under_shear(self) -> Float32[np.ndarray, '2 near near']:
        """How far (mm) the surface goes along x under 1 N along x on a patch, there and at the patches around it, and
        along y likewise."""
        kernels = self.surface.kernels(self.surface.rectangle(*self.patches.size_mm))
        cols, rows = (cells // 2 + FINER * np.arange(-NEAR, NEAR + 1) for cells in self.surface.cells)
        return np.stack([kernels[1, 0, 0], kernels[2, 0, 1]])[:, rows[:, None], cols]

    @cached_property
    def _layers(self) -> tuple[tuple[float, ElasticLayer], ...]:
        """The gel where it is so much thinner (mm) than in the middle: of a flat one the layer alone."""
        if not self.sensor.gel.dome_radius_mm:
            return ((0.0, self.layer),)
        thinner = np.linspace(0, self.sensor.gel.sag_mm, THICKNESSES).tolist()
        return tuple((each, self._layer_at(self.depths_mm, each)) for each in thinner)

    def _as_thick(self, places_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'layers n']:
        """How much each of these layers counts at places of the surface."""
        thinner = [each for each, _ in self._layers]
        sag = -self.sensor.gel.dome.height_mm(places_mm)
        return np.array([np.interp(sag, thinner, one) for one in np.eye(len(thinner))])

    def _layer_at(self, depths_mm: Float[np.ndarray, ' depths'], thinner_mm: float = 0.0) -> ElasticLayer:
        gel = self.sensor.gel
        thick_mm = *gel.layers_mm[:-1], gel.layers_mm[-1] - thinner_mm
        stack = [Elastic(*each) for each in zip(thick_mm, gel.moduli_mpa, gel.poisson_ratios, strict=True)]
        width, height = self.patches.size_mm
        repeated_mm = max(WIDTH_MM, 2 * gel.width_mm, 2 * gel.height_mm)
        return ElasticLayer(stack, depths_mm, (width / FINER, height / FINER), repeated_mm)

    @property
    def nominal_shares(self) -> Float[np.ndarray, ' terms']:
        """What each term counts if nothing is known of a region: depths by how distinct markers there are."""
        away = np.abs(-self.depths_mm - self.sensor.camera.position_mm[2])
        shares = np.zeros((DEPTHS, 3))
        shares[:, 0] = away**BRIGHTNESS / (away**BRIGHTNESS).sum()
        return shares.reshape(-1)

    @cached_property
    def _seen(self) -> tuple[Float[np.ndarray, 'depths regions rays 2'], Float[np.ndarray, 'depths regions rays 2 3']]:
        """Where rays meet the depths (mm), and by how many pixels a millimetre there moves the picture."""
        points = np.stack([self._points(depth) for depth in self.depths_mm])
        steps = DISPLACEMENT_MM * np.eye(3)
        moved = [
            (self._project(points + step) - self._project(points - step)) / (2 * DISPLACEMENT_MM) for step in steps
        ]
        shape = DEPTHS, self.count, RAYS * RAYS
        return points[..., :2].reshape(*shape, 2), np.stack(moved, -1).reshape(*shape, 2, 3)

    @property
    def uneven(self) -> float:
        """How much motion changes over a region's window: its width over twice the depth of the markers in the middle.

        0.3 on the paper's sensor, 2.1 where a window of 1.5 mm shows speckle 0.35 mm below the surface.
        """
        window_mm = WINDOW * self.sensor.image.crop_px[0] / self.cols / self.px_per_mm
        return window_mm / (2 * float(self.depths_mm[DEPTHS // 2]))

    @property
    def px_per_mm(self) -> float:
        """By how many pixels a millimetre along x moves the picture, where markers are in the middle (median)."""
        return float(np.median(np.abs(self._seen[1][DEPTHS // 2, ..., 0, 0])))

    @property
    def within_gel(self) -> Bool[np.ndarray, ' regions']:
        """Which regions see nothing but the gel, at every depth where something is visible."""
        return np.asarray(self.sensor.gel.outline.holds(self._seen[0]).all(axis=(0, 2)))

    @property
    def covered(self) -> Bool[np.ndarray, ' regions']:
        """Which regions have a window with something in it that the mask covers."""
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
        """Which regions see the gel, and nothing else."""
        usable: np.ndarray = self.within_gel & ~self.covered
        return usable

    def shares_of(self, place_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
        """Where `middle_seen_at` has places, as shares of the sides of what is cut (x, y)."""
        return np.asarray((self.middle_seen_at(place_mm) + 0.5) / self.sensor.image.crop_px)

    def middle_seen_at(self, place_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
        """Where places are in what is cut from the camera's picture (px), in the middle of the markers' depths."""
        return self.below_seen_at(place_mm, float(self.depths_mm[DEPTHS // 2]))

    def below_seen_at(self, place_mm: Float[np.ndarray, 'n 2'], depth_mm: float) -> Float[np.ndarray, 'n 2']:
        """The same, so deep below the surface."""
        return self.seen_at(np.column_stack([place_mm, self.sensor.gel.dome.height_mm(place_mm) - depth_mm]))

    def _points(self, depth_mm: float) -> Float[np.ndarray, 'rays 3']:
        """Where the rays of all windows meet a depth, in the surface frame."""
        towards = self._camera.unproject(self._pixels) @ self._turn.T
        place = np.asarray(self.sensor.camera.position_mm, float)
        forwards, height = np.maximum(towards[:, 2], 1e-3), np.zeros(len(towards))
        for _ in range(MEETING if self.sensor.gel.dome_radius_mm else 1):
            points: np.ndarray = place + towards * ((height - depth_mm - place[2]) / forwards)[:, None]
            height = self.sensor.gel.dome.height_mm(points[:, :2])
        return points

    def seen_at(self, points_mm: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 2']:
        """Where points in the surface frame are in what is cut from the camera's picture (px)."""
        image = self.sensor.image
        corner = (np.array([image.width, image.height]) - np.array(image.crop_px)) // 2
        return np.asarray(self._project(points_mm[None])[0] - corner)

    def _project(self, points: Float[np.ndarray, 'depths rays 3']) -> Float[np.ndarray, 'depths rays 2']:
        away = (points - np.asarray(self.sensor.camera.position_mm, float)) @ self._turn
        pixels: np.ndarray = self._camera.project(away.reshape(-1, 3)).reshape(*points.shape[:2], 2)
        return pixels

    @property
    def _camera(self) -> Camera:
        camera, image = self.sensor.camera, self.sensor.image
        u, v = camera.centre_px
        if camera.model == 'pinhole':
            across, down = camera.focal_px
            return PinholeCamera(image.width, image.height, (across, down), (u, v), camera.distortion)
        return FisheyeCamera(
            image.width, image.height, camera.focal_px_per_rad, (u, v), camera.lens, camera.focal_ratio
        )

    @property
    def _turn(self) -> Float[np.ndarray, '3 3']:
        """The camera's axes in the surface frame, as columns."""
        return rotation(np.radians([*self.sensor.camera.tilt_deg, self.sensor.camera.roll_deg]))

    @property
    def _pixels(self) -> Float[np.ndarray, 'rays 2']:
        """Of the rays of each region's window, region by region, in the camera's whole picture."""
        image = self.sensor.image
        cut = np.array(image.crop_px)
        side = cut / np.array([self.cols, self.rows])
        within = (np.arange(RAYS) + 0.5) / RAYS - 0.5
        corner = (np.array([image.width, image.height]) - cut) // 2
        u, v = (
            corner[axis] - 0.5 + side[axis] * (np.arange(count)[:, None] + 0.5 + WINDOW * within)
            for axis, count in ((0, self.cols), (1, self.rows))
        )
        shape = self.rows, self.cols, RAYS, RAYS
        across, down = np.broadcast_to(u[None, :, None, :], shape), np.broadcast_to(v[:, None, :, None], shape)
        return np.stack([across, down], -1).reshape(-1, 2)

    def terms_of_patches(self, known: Int[np.ndarray, ' known']) -> Float32[np.ndarray, 'known 2 terms unknowns']:
        """Motion (px) of some regions by term under 1 N on each patch.

        Unknowns are all normal forces, then those along x, then those along y. Where a patch's middle is beside the gel
        nothing moves.
        """
        patches = self.patches
        if not self.sensor.gel.dome_radius_mm:
            split = self._terms_in(self.layer, known)
        else:
            shares = self._as_thick(patches.centres_mm).astype(np.float32)
            split = sum(
                share * self._terms_in(layer, known) for share, (_, layer) in zip(shares, self._layers, strict=True)
            )
            split = np.einsum('rdplsc,clm->rdpmsc', split, self._loads_at(patches.centres_mm), optimize=True)
        split[..., ~self.sensor.gel.outline.holds(patches.centres_mm)] = 0
        ordered: np.ndarray = split.transpose(0, 2, 1, 4, 3, 5).reshape(len(known), 2, TERMS, 3 * patches.count)
        return ordered

    def _loads_at(self, places_mm: Float[np.ndarray, 'n 2']) -> Float32[np.ndarray, 'n 3 3']:
        """What of forces into the gel, along x and along y is such a force on the surface as it leans at places."""
        leaning = self.sensor.gel.dome.axes(places_mm) @ LOADS
        return np.asarray(leaning.swapaxes(-1, -2) @ LOADS, np.float32)

    @cached_property
    def _moves(self) -> Float[np.ndarray, 'depths regions rays 2 3']:
        """By how many pixels a millimetre along the surface above and out of it moves the picture.

        What is deeper follows the base, which is flat, by so much more.
        """
        places, moves = self._seen
        gel = self.sensor.gel
        if not gel.dome_radius_mm:
            return moves
        share = 1 - self.depths_mm[:, None, None] / (gel.depth_mm + gel.dome.height_mm(places))
        return np.asarray(moves @ gel.dome.axes(places, share))

    def _terms_in(
        self, layer: ElasticLayer, known: Int[np.ndarray, ' known']
    ) -> Float32[np.ndarray, 'known depths 2 loads sets patches']:
        """The same in a flat layer, as its surface has the forces."""
        patches = self.patches
        fields = fields_of(layer, layer.rectangle(*patches.size_mm))
        (rows, cols), jacobian = patches.shape, (self._moves[:, known] / RAYS**2).astype(np.float32)
        node, part = (each[:, known] for each in self._last_patch(patches))
        terms = np.zeros((len(known), DEPTHS, 2, 9 * patches.count), np.float32)
        for depth in range(DEPTHS):
            combs = combed(fields[depth], (rows, cols))
            for region, ray in np.ndindex(len(known), RAYS * RAYS):
                block = between(combs, node[depth, region, ray], part[depth, region, ray], (rows, cols))
                terms[region, depth] += jacobian[depth, region, ray] @ block.reshape(3, -1)
        return terms.reshape(len(known), DEPTHS, 2, 3, 3, patches.count)

    def _last_patch(self, patches: PatchGrid) -> tuple[np.ndarray, np.ndarray]:
        """Node of the layer's grid at which a ray lies as seen from the last patch, and what is left of a step."""
        last = np.array([each[-1] for each in patches.lines_mm])
        steps = (self._seen[0] - last) / np.asarray(self.layer.spacing_mm) + np.array(self.layer.cells) // 2
        node = np.floor(steps)
        rest: np.ndarray = steps - node
        return node.astype(int), rest.astype(np.float32)

    def terms_of_pressure(
        self,
        places_mm: Float[np.ndarray, 'presses 2'],
        spectrum: Inexact[np.ndarray, 'ky kx'],
        known: Int[np.ndarray, ' known'],
    ) -> Float32[np.ndarray, 'presses known 2 terms']:
        """Motion (px) of some regions by term under 1 N of a pressure about each place; `ElasticLayer.points` makes its
        spectrum."""
        domed = self.sensor.gel.dome_radius_mm > 0
        in_layers = [fields_of(layer, spectrum, pressed_only=not domed) for _, layer in self._layers]
        shares, loads = self._as_thick(places_mm), self._loads_at(places_mm)[..., 0]
        seen, jacobian = self._seen[0][:, known], self._moves[:, known]
        found = np.zeros((len(places_mm), len(known), 2, DEPTHS, 3), np.float32)
        for number, place in enumerate(places_mm):
            fields = in_layers[0][:, :, 0]
            if domed:
                there = sum(share * each for share, each in zip(shares[:, number], in_layers, strict=True))
                fields = np.einsum('dclsyx,l->dcsyx', there, loads[number])
            at = (seen - place) / np.asarray(self.layer.spacing_mm) + np.array(self.layer.cells) // 2
            for depth in range(DEPTHS):
                sampled = sampled_at(fields[depth].reshape(9, *fields.shape[-2:]), at[depth])
                sampled = sampled.reshape(3, 3, len(known), -1)
                found[number, :, :, depth] = np.einsum('rnpc,csrn->rps', jacobian[depth], sampled) / RAYS**2
        return found.reshape(len(places_mm), len(known), 2, TERMS)
