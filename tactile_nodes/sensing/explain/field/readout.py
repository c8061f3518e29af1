"""The readout `field`: explains each frame by the simplest of nothing, tips, or a force field."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import cv2
import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.contacts import contacts_of
from tactile_nodes.sensing.explain.field.refinement import Refinement, inputs_of
from tactile_nodes.sensing.explain.field.solver import UNSEEN_N, Field, FieldSolver
from tactile_nodes.sensing.explain.field.spread import TIPS_OUT_OF_SIGHT, FieldSpread
from tactile_nodes.sensing.explain.field.sums import about, covariance_of_tips, sums
from tactile_nodes.sensing.explain.field.weights import Weights, camera_ways
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.noise import FOUND_NOISE, inside_of, noise_of
from tactile_nodes.sensing.explain.reading import (
    UNKNOWN,
    Acting,
    Contact,
    Reading,
    SurfaceField,
    nothing_read,
)
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Bool, Float, Float32, Int

LEAST_REGIONS = 12
MOST_TIPS = 3
TIP_BINS = 3
"""A tip's force covers bins within at most this many rows and columns."""

PEAKS, CLEAR = (0.5, 0.25), 3.0
"""In the linear estimate, a place at half the highest force must be no wider than a tip, and places down to a quarter
are searched; both above this many standard deviations of its noise."""

TABLE_SHARE = 0.78
"""Least share of the motion that tips from the table explain: for one to three tips anywhere it is more in 99 of 100
cases, from 20 mN on."""

WORTH = 2.0
"""Novelty beyond which tips are rejected as explanation. After the first step it is at most 1.3 for one tip and 1.6
for two; for other bodies it is 2.2 or more."""

ALIKE = 0.93
"""Novelty up to which tips explain a frame, so that the field is not computed."""


STILL = np.zeros((2, 1, 1), np.float32)
"""A surface with unknown motion under shear, for older models."""


@dataclass(frozen=True)
class FieldReadout:
    """Estimates any contact from the motion of regions.

    `scaling` holds the regions' values at rest and which regions are known. `response` is their motion [px] under 1 N
    on each patch, as in `FieldSolver`. `misfit_limit` is the misfit that counts as novelty 1. `least_gain` is the least
    gain of any force. `tips` reads frames in which only tips press. `surface` is the motion of the surface under shear,
    as in `moved_along`. `passes` is as in `FieldSolver`. `refinement` redistributes the forces of a field.
    """

    scaling: InputScaling
    response: Float32[np.ndarray, 'rows unknowns']
    bins: BinGrid
    noise_px: float
    doubt: float = 0.03
    spread: FieldSpread = field(default_factory=FieldSpread)
    misfit_limit: float = 1.5
    least_gain: float = 8.0
    tips: AxisymmetricReadout | None = None
    surface: Float32[np.ndarray, '2 near near'] = field(default_factory=lambda: STILL)
    compiled: bool = False
    passes: int = 1
    refinement: Refinement | None = None

    kind = 'field'

    @property
    def parameter_count(self) -> int:
        """Parameters of the response, of the scaling, and of the readout for tips."""
        parts = [each.parameter_count for each in (self.tips, self.refinement) if each is not None]
        return self.response.size + 2 * self.scaling.mean.size + sum(parts)

    def nominal_n(self, total_n: float) -> float:
        return self.spread.nominal_n(total_n)

    def require_fit(self, features: int, bins: BinGrid) -> None:
        known = int((self.scaling.trusted > 0).sum())
        wanted = 2 * known, 3 * PatchGrid(bins).count
        if self.scaling.mean.size != features or bins != self.bins or self.response.shape != wanted:
            raise ModelError(
                f'a field of {self.response.shape[0]} motions, {self.scaling.mean.size} features and {self.bins} does '
                f'not fit {features} features and {bins}; calibrate it again or use another model file'
            )
        if self.tips is not None:
            self.tips.require_fit(features, bins)

    @cached_property
    def solver(self) -> FieldSolver:
        """The solver of the field."""
        camera = camera_ways(self.scaling.trusted.shape, self._known)
        return FieldSolver(
            self.response, camera, PatchGrid(self.bins), self.noise_px, self.doubt, self.compiled, self.passes
        )

    @cached_property
    def _known(self) -> np.ndarray:
        return np.flatnonzero(self.scaling.trusted.reshape(-1) > 0)

    @cached_property
    def _inside(self) -> np.ndarray:
        return inside_of(self.scaling.trusted > 0)

    def weighed(
        self,
        values: Float32[np.ndarray, 'rows cols channels'],
        confidence: Float[np.ndarray, 'rows cols'],
        flow_noise_px: float = 0.0,
    ) -> tuple[float, Float[np.ndarray, 'regions 2'], Weights]:
        """The noise of a frame [px], the motion of the known regions since rest, and their weights.

        `flow_noise_px` is the noise that the flow method tells, or 0.
        """
        moved = values - self.scaling.mean
        motion = moved.reshape(-1, 2)[self._known].astype(float)
        noise_px = max(noise_of(moved, self._inside), flow_noise_px)
        return noise_px, motion, self.solver.weights(motion, confidence.reshape(-1)[self._known], noise_px)

    def observed(
        self,
        values: Float32[np.ndarray, 'rows cols channels'],
        confidence: Float32[np.ndarray, 'rows cols'],
        flow_noise_px: float = 0.0,
    ) -> tuple[float, Float[np.ndarray, 'regions 2'], Weights] | None:
        """As `weighed`; None if the motion is not finite or too few regions are seen."""
        if self.compiled:
            return self._observed_by_loops(values, confidence, flow_noise_px)
        sure = confidence.reshape(-1)[self._known] >= self.scaling.confidence_floor
        if np.count_nonzero(sure) < LEAST_REGIONS or not np.isfinite(values.reshape(-1, 2)[self._known]).all():
            return None
        return self.weighed(values, confidence, flow_noise_px)

    def _observed_by_loops(
        self,
        values: Float32[np.ndarray, 'rows cols channels'],
        confidence: Float32[np.ndarray, 'rows cols'],
        flow_noise_px: float,
    ) -> tuple[float, Float[np.ndarray, 'regions 2'], Weights] | None:
        """The same, compiled."""
        camera = self.solver.camera
        motion, single = np.empty((len(self._known), 2)), np.empty(len(camera), np.float32)
        shared, usual_px = np.empty(camera.shape, np.float32), max(self.noise_px, flow_noise_px)
        followed, noise_px = compiled_loops().weighed(
            np.ascontiguousarray(values), np.ascontiguousarray(confidence), self.scaling.mean, self._known,
            self._inside, camera, (self.scaling.confidence_floor, usual_px, self.doubt), motion, single, shared,
        )  # fmt: skip
        return None if followed < LEAST_REGIONS else (max(noise_px, flow_noise_px), motion, Weights(single, shared))

    def read(
        self,
        values: Float32[np.ndarray, 'rows cols channels'],
        confidence: Float32[np.ndarray, 'rows cols'],
        flow_noise_px: float = 0.0,
    ) -> Reading:
        """The simplest explanation of a frame: nothing, tips that only press, or the field; NaN if it is not unique.

        Tips are chosen if their residual is no larger than in their training, or if the field does not explain more
        after a penalty of one for each of its patches (Akaike 1974). The field is taken if the log-likelihood gains at
        least `least_gain`, and one for each of its forces. `flow_noise_px` is as in `weighed`.
        """
        if (observed := self.observed(values, confidence, flow_noise_px)) is None:
            return nothing_read(self.bins)
        noise_px, motion, weights = observed
        coarse = self.solver.coarse(motion)
        tips = self._tips(coarse, noise_px / FOUND_NOISE, values, confidence)
        if tips is not None and tips[0].unlikeness <= ALIKE:
            return self._with_acting(tips[0])
        try:
            found = self.solver.field(motion, weights, coarse)
        except np.linalg.LinAlgError:  # as where the picture shows a part of the gel only
            return nothing_read(self.bins)
        unlike, count = found.misfit / self.misfit_limit, len(found.active)
        if tips is not None:
            left, numbers = tips[1].reshape(-1, 2)[self._known].astype(float).reshape(-1), 3 * len(tips[0].contacts)
            if weights.squared(left) + 2 * numbers <= len(left) * found.misfit**2 + 2 * count:
                return self._with_acting(tips[0])
        least = max(self.least_gain, self.solver.unknowns(count))
        if found.gain < least:
            return self._untouched(unlike, self.solver.unseen_n(weights, least))
        found = self.refined(found, motion, noise_px)
        return self._reading(found, unlike, self.solver.reduced_n(weights, found.total_n))

    def refined(self, found: Field, motion: Float[np.ndarray, 'regions 2'], noise_px: float) -> Field:
        """A solved field with its forces redistributed, if it explains the frame's motion and there is a refinement."""
        if self.refinement is None or found.misfit > self.misfit_limit:
            return found
        return self.refinement.refined(found, self._inputs(found, motion, noise_px))

    def solved(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> tuple[Field, Float32[np.ndarray, 'inputs h w']] | None:
        """The field that explains a frame, before it is refined, and the inputs of a refinement; None if none does."""
        if (observed := self.observed(values, confidence)) is None:
            return None
        noise_px, motion, weights = observed
        try:
            found = self.solver.field(motion, weights)
        except np.linalg.LinAlgError:
            return None
        return (found, self._inputs(found, motion, noise_px)) if found.active.size else None

    def _inputs(
        self, found: Field, motion: Float[np.ndarray, 'regions 2'], noise_px: float
    ) -> Float32[np.ndarray, 'inputs h w']:
        """The inputs of a refinement."""
        maps = np.zeros((self.scaling.trusted.size, 4), np.float32)
        maps[self._known, :2] = motion - self.solver.motion_under(found).reshape(-1, 2)
        maps[self._known, 2:] = motion
        noise_px = max(noise_px, self.noise_px)
        return inputs_of(found, maps.reshape(*self.scaling.trusted.shape, 4), noise_px, self.solver.patches.shape)

    def _tips(
        self, coarse: Float[np.ndarray, ' bins'], noise_px: float, values: np.ndarray, confidence: np.ndarray
    ) -> tuple[Reading, Float32[np.ndarray, 'rows cols 2']] | None:
        """The frame explained by tips that only press, if possible, and the residual motion."""
        if self.tips is None or not (count := self._places(coarse, noise_px)):
            return None
        observed = self.tips.observed(values, confidence)
        if not observed.enough:
            return None
        noisier = max(1.0, noise_px / self.tips.usual_px)
        if self.tips.share_of(observed, noisier, count) < TABLE_SHARE:
            return None
        worth = WORTH * noisier
        fit = self.tips.fit(observed, count, worth)
        if fit.misfit > (worth * self.tips.calibration.misfit_limit) ** 2:
            return None
        left = self.tips.left_over(observed, fit)
        reading = self.tips.reading_of_fit(observed, fit, left, anywhere=self.tips.response.sides is None)
        return (reading, left) if reading.contacts[0].force_n else None

    def prepare(self) -> None:
        """Prepare everything that would delay the first frame."""
        still = np.zeros(self.scaling.mean.shape, np.float32)
        self.read(still, np.ones(still.shape[:2], np.float32))
        if self.tips is not None:
            self.tips.read(still, np.ones(still.shape[:2], np.float32))

    def _places(self, coarse: Float[np.ndarray, ' bins'], noise_px: float) -> int:
        """Greatest number of tips, 1 if the linear estimate shows none; 0 if it excludes tips."""
        noise_n = CLEAR * noise_px * self.solver.coarse_noise_n
        half, quarter = (coarse > np.maximum(share * coarse.max(), noise_n) for share in PEAKS)
        if (self._together(half) > TIP_BINS).any():
            return 0
        return min(max(len(self._together(quarter)), 1), MOST_TIPS)

    def _together(self, on: Bool[np.ndarray, ' bins']) -> Int[np.ndarray, 'places 2']:
        """Columns and rows of each connected group of bins."""
        grid = on.reshape(self.bins.rows, self.bins.cols).astype(np.uint8)
        boxes = cv2.connectedComponentsWithStats(grid, connectivity=8)[2]
        sides: np.ndarray = boxes[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
        return sides

    def _reading(self, found: Field, unlike: float, reduced_n: float) -> Reading:
        patches, usual = self.solver.patches, self.spread.unfit() if unlike > 1 else self.spread
        summed = sums(found, self.surface, patches, compiled=self.compiled)
        spread = usual.out_of_sight(self.solver.hidden(found.forces_n[0])).reduced(reduced_n)
        covariance = spread.covariance(summed.field, patches, summed.wrench_covariance)
        forces = summed.bins_n.astype(np.float32)
        off = spread.bins_n(summed.bins_n[0], summed.bins_off_n).astype(np.float32)
        acting = Acting(
            'field', np.moveaxis(forces[1:], 0, -1), off, summed.wrench, covariance,
            partial(self._surface, summed.field, max(unlike, 1.0)),
        )  # fmt: skip
        contacts, sigma_n = contacts_of(summed.contacts, spread), math.sqrt(covariance[2, 2])
        return Reading(forces[0], contacts, sigma_n, unlike, acting=acting)

    def _surface(self, found: Field, widened: float) -> SurfaceField:
        """Pressure and shear on the patches."""
        patches = self.solver.patches
        area = float(np.prod(patches.size_mm))
        count = len(found.active)
        deviations = np.full((3, patches.count), UNSEEN_N)
        if count:
            deviations[:, found.active] = np.linalg.norm(found.root, axis=0).reshape(3, count)
        maps = [(each / area).reshape(patches.shape).astype(np.float32) for each in found.forces_n]
        pressed, along_x, along_y = ((widened * each / area).reshape(patches.shape) for each in deviations)
        sheared = np.sqrt((np.square(along_x) + np.square(along_y)) / 2)
        return SurfaceField(maps[0], np.stack(maps[1:], -1), pressed.astype(np.float32), sheared.astype(np.float32))

    def nothing(self, sigma_n: float | None = None) -> Acting:
        """The result without a detected force; without `sigma_n` with the nominal error.

        A hidden force may act on any patch, so the torque is the less certain, the larger the surface.
        """
        patches = self.solver.patches
        still = Field(np.zeros((3, patches.count)), np.zeros(0, int), np.zeros((0, 0)), 0.0, 0.0)
        shape = self.bins.rows, self.bins.cols
        off_n = sigma_n or self.spread.nominal[0]
        ways = patches.levers.reshape(-1, 6)
        off = off_n**2 / patches.count * (ways.T @ ways)
        return Acting(
            'nothing', np.zeros((*shape, 2), np.float32), np.full(shape, off_n, np.float32), np.zeros(6), off,
            partial(self._surface, still, off_n / self.spread.nominal[0]),
        )  # fmt: skip

    def _untouched(self, unlike: float, unseen_n: float) -> Reading:
        """No force, as far as the picture shows: a force up to `unseen_n` may be hidden.

        An untouched gel is assumed to be as likely as a touched one, and all forces up to there to be equally likely.
        The root mean square of the force is then `unseen_n` / √6.
        """
        none = np.zeros((self.bins.rows, self.bins.cols), np.float32)
        sigma_n = max(self.spread.nominal[0], unseen_n / math.sqrt(6))
        contact = Contact(0.0, 0.0, 0.0, UNKNOWN, sigma_n)
        return Reading(none, (contact,), sigma_n, unlike, acting=self.nothing(sigma_n))

    def _with_acting(self, reading: Reading) -> Reading:
        """Add to tips the maps of a field: no shear, and pressure on the patches around their places."""
        patches = self.solver.patches
        pressed = np.zeros(patches.count)
        for each in reading.contacts:
            pressed += each.force_n * about(each.x_mm, each.y_mm, patches)
        reading = _as_visible(reading, self.solver.hidden(pressed))
        forces = np.stack([pressed, np.zeros_like(pressed), np.zeros_like(pressed)])
        still = Field(forces, np.zeros(0, int), np.zeros((0, 0)), reading.unlikeness, 0.0)
        places = np.array([[each.x_mm, each.y_mm, each.force_n] for each in reading.contacts])
        x, y, force = places.T
        wrench = np.array([0.0, 0.0, -force.sum(), -(y * force).sum(), (x * force).sum(), 0.0])
        covariance = covariance_of_tips(reading.contacts, self.spread)
        none = np.zeros((self.bins.rows, self.bins.cols, 2), np.float32)
        share = reading.total_sigma_n / max(float(force.sum()), 1e-6)
        sigma = np.maximum(share * reading.normal_force_n, 0.0).astype(np.float32)
        acting = Acting('tips', none, sigma, wrench, covariance, partial(self._surface, still, 1.0))
        return replace(reading, acting=acting)


def _as_visible(tips: Reading, hidden: float) -> Reading:
    """Tips with the additional error of forces that are `hidden`, as in `FieldSpread.out_of_sight`."""
    off = TIPS_OUT_OF_SIGHT * hidden
    contacts = tuple(replace(each, sigma_n=math.hypot(each.sigma_n, off * each.force_n)) for each in tips.contacts)
    return replace(tips, contacts=contacts, total_sigma_n=math.hypot(*(each.sigma_n for each in contacts)))
