"""Solves for the force field that explains the motion of regions: normal force and shear on surface patches.

Least squares with p >= 0 and |q| <= p: first on the bins in which a linear estimate finds force, then on the patches
with force around them. If markers lie near the surface, regions see details smaller than a bin, and the linear estimate
selects the wrong bins. Then all bins are solved, and the result is refined. A uniform pressure on an incompressible
layer causes almost no motion, so that smeared forces would fit too. A reweighted l1 term penalises a patch more, the
less force there is around it, and less in wide contacts. The motion of the camera is estimated with the forces. The
weights of regions are in `tactile_nodes.sensing.explain.field.weights`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.elasticity.patches import PER_BIN, PatchGrid
from tactile_nodes.sensing.explain.field.cone import NOT_APART, STEPS, inverse_root, least_squares
from tactile_nodes.sensing.explain.field.weights import Weights, region_weights
from tactile_nodes.shapes import Bool, Float, Float32, Int

FRICTION = 1.0
"""Upper bound of shear over pressure (not an estimate): rubber on skin does not hold more for long."""

HELD, SPREAD = 7.0, 0.003
"""Weight of the reweighted l1 term, and the share of the total force that is assumed around every patch."""

LIGHTLY_HELD, HELD_PER_N = 5000.0, 35.0
"""Once the patches are chosen, the weight of the term is LIGHTLY_HELD times the squared relative error of the response
(which more force would explain), or HELD_PER_N times the highest force on a patch if that is more, and at most HELD.
With HELD in all contacts, totals after 100 presses are 51 and 39 mN off (rms) instead of 38 and 29 mN
(`tactile bench contacts --seed 909 --no-disturbances`, and with `--seed 717`)."""

CENTRED = 0.6
"""Share of the penalty's mean (over the force) that is subtracted from it if there are few regions. A penalty above
zero everywhere makes forces too small, which the motion of few regions hardly contradicts. With a share of 1, the total
would follow from the motion alone, noise included. Totals of contacts on printed dots are 13 % off in the median, 30 %
without it; on the gel `digit_like` 15 and 22 % (`tactile bench sensors --each 3 --seed 909`)."""

OF_A_TIP = 16
"""Patches under a tip: two by two bins."""

WIDE = 20.0
"""Number of patches from which on a contact is wide: the middle of a wide contact causes almost no motion, so the l1
penalty decreases with the square of the number."""

UNSEEN_N = 0.012
"""Force that noise can hide on a patch whose force is reported as zero."""

ON_BINS, FIRST_STEPS = 2.0, 10
"""Penalty of bins over that of patches, and solver steps on bins. The result only selects the patches to solve and
their penalties."""

GRANTED = 50.0
"""Weight of a ridge term [1/N²] on all forces: without evidence no force reaches some hundred mN."""

COARSE = 300.0
"""The same for the linear estimate on bins."""

UNSTABLE = 3e-6
"""Its least value, over the largest information on any force: the limit of 32-bit floats."""

EVEN_N = 0.1
"""Force assumed on each bin if nothing is known of the places of forces."""

LEAST_SHOWN = 0.1
"""Least visibility of forces, over the usual one: less visible forces are rarely estimated."""

ACTIVE, LEAST_N = 0.05, 1e-3
"""Bins with this share of the strongest bin's force, and at least this force, are solved; then patches with this share
of the strongest surroundings."""


@dataclass(frozen=True)
class Field:
    """Forces on patches [N]: into the gel, along x, along y; and their uncertainty.

    `active` are the patches that were solved. With `root` R, R'R is the covariance of their forces: first all normal
    ones, then along x, then along y. `misfit` is the root mean square of the residual in units of its expected standard
    deviation. `gain` is the log-likelihood ratio to no force (half the decrease of the squared misfit).
    """

    forces_n: Float[np.ndarray, '3 patches']
    active: Int[np.ndarray, ' n']
    root: Float[np.ndarray, 'm m']
    misfit: float
    gain: float

    @property
    def total_n(self) -> float:
        return float(self.forces_n[0].sum())

    @property
    def wide(self) -> float:
        """Excess width over a fully visible contact: 0, up to 1 for twice the width."""
        return min(max(spread_over(self.forces_n[0]) / WIDE - 1, 0.0), 1.0)

    def deviations(self, levers: Float[np.ndarray, 'm sums']) -> Float[np.ndarray, ' sums']:
        """Standard deviations of sums of the active patches' forces (or of the first of them) times levers."""
        each = self.root[:, : len(levers)] @ levers.astype(self.root.dtype)
        deviations: np.ndarray = np.sqrt(np.einsum('ms,ms->s', each, each)).astype(float)
        return deviations


def spread_over(pressed: Float[np.ndarray, ' patches']) -> float:
    """Effective number of patches: 1 for one patch, n for n equal ones; noise is left out."""
    above = np.maximum(pressed - UNSEEN_N / 2, 0.0)
    return max(float(above.sum()) ** 2 / max(float(above @ above), 1e-12), 1.0)


@dataclass(frozen=True)
class FieldSolver:
    """Estimates forces on patches from the motion of regions.

    `response` is the motion [px] of the known regions, along x and y, under 1 N on each patch: normal, along x, along
    y. `camera` is their motion under the usual motion of the camera. `noise_px` is the least noise of a region, `doubt`
    the relative error of the response. `passes` is how often a frame is solved; with more than one, the first pass uses
    all bins, and each later pass starts from the result before.
    """

    response: Float32[np.ndarray, 'rows unknowns']
    camera: Float[np.ndarray, 'rows ways']
    patches: PatchGrid
    noise_px: float
    doubt: float
    compiled: bool = False
    passes: int = 1

    def weights(
        self, motion: Float[np.ndarray, 'regions 2'], confidence: Float[np.ndarray, ' regions'], noise_px: float = 0.0
    ) -> Weights:
        """Weights of the regions in a frame with this noise, along x and along y, without the camera's motion."""
        noise_px = max(noise_px, self.noise_px)
        return Weights.of(region_weights(motion, confidence, noise_px, self.doubt), self.camera)

    @cached_property
    def _by_bin(self) -> Float32[np.ndarray, 'unknowns rows']:
        """Motion under 1 N of each force, spread evenly over a bin."""
        member = self.patches.member * self._on_gel[:, None]
        member /= np.maximum(member.sum(axis=0), 1)
        by_bin = [member.T @ part for part in np.split(self.response.T.astype(float), 3)]
        return np.concatenate(by_bin).astype(np.float32)

    @cached_property
    def _coarse(self) -> Float32[np.ndarray, 'bins rows']:
        """The matrix of the linear estimate of normal forces on bins for usual noise, without the camera's motion."""
        on_bins = self._by_bin.astype(float)
        even = Weights.of(np.full(on_bins.shape[1] // 2, self.noise_px**-2), self.camera).times(on_bins)
        solved: np.ndarray = np.linalg.solve(even @ on_bins.T + COARSE * np.eye(len(even)), even)
        return solved[: self.patches.bins.count].astype(np.float32)

    def coarse(self, motion: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, ' bins']:
        """Linear estimate of normal forces on bins, clipped at 0."""
        answer: np.ndarray = self._coarse @ motion.reshape(-1).astype(np.float32)
        pressed: np.ndarray = np.maximum(answer, 0.0, dtype=float)
        return pressed

    @cached_property
    def coarse_noise_n(self) -> Float32[np.ndarray, ' bins']:
        """Standard deviation of the linear estimate on each bin, before it is clipped, for 1 px of noise."""
        return np.asarray(np.linalg.norm(self._coarse, axis=1))

    def field(
        self,
        motion: Float[np.ndarray, 'regions 2'],
        weights: Weights,
        coarse: Float[np.ndarray, ' bins'] | None = None,
    ) -> Field:
        """The field that explains a motion best; `coarse` is the linear estimate, if it is already known."""
        flat = motion.reshape(-1).astype(float)
        if self.passes == 1:
            return self._solved(self.coarse(motion) if coarse is None else coarse, flat, weights)
        bins = np.arange(self.patches.bins.count)
        found = self._summed(self._on_bins(bins, np.full(bins.size, EVEN_N), flat, weights))
        for _ in range(self.passes):
            field = self._solved(found, flat, weights)
            found = self._summed(field.forces_n[0])
        return field

    def _solved(
        self, around: Float[np.ndarray, ' bins'], motion: Float[np.ndarray, ' rows'], weights: Weights
    ) -> Field:
        """The best field on the bins with force around them."""
        on = around > max(ACTIVE * around.max(), LEAST_N)
        if not on.any():
            return self._nothing(motion, weights)
        if self.compiled:
            return self._by_loops(around, motion, weights)
        pressed = self._on_bins(np.flatnonzero(on), around, motion, weights)
        nearby = self._nearby(pressed)
        active = np.flatnonzero((nearby > ACTIVE * nearby.max()) & on[self.patches.bin_of] & self._on_gel)
        if not active.size:
            return self._nothing(motion, weights)
        caused = self._caused(self._by_force, active)
        information, evidence = self._evidence(caused, GRANTED * self._regularization, motion, weights)
        evidence[: active.size] -= self._held(pressed, nearby, self._weight_of(nearby))[active]
        forces = np.zeros((3, self.patches.count))
        found = least_squares(information, evidence, FRICTION, STEPS)
        forces[:, active] = found.reshape(3, -1)
        left = motion - forces[:, active].reshape(-1) @ caused
        return Field(forces, active, inverse_root(information), *self._fit(motion, left, weights))

    def _by_loops(
        self, around: Float[np.ndarray, ' bins'], motion: Float[np.ndarray, ' rows'], weights: Weights
    ) -> Field:
        """The same, compiled."""
        able, forces, active, root, before, after = compiled_loops().field(
            (self._by_bin, self._by_force), self.patches.bin_of, around, motion, (weights.single, weights.shared),
            self.patches.shape[1], (self._regularization, self._lightly_held),
        )  # fmt: skip
        if not able:
            raise np.linalg.LinAlgError(NOT_APART)
        return Field(forces, active, root, *_misfit_and_gain(before, after, len(motion)))

    def _on_bins(
        self,
        bins: Int[np.ndarray, ' n'],
        around: Float[np.ndarray, ' bins'],
        motion: Float[np.ndarray, ' rows'],
        weights: Weights,
    ) -> Float[np.ndarray, ' patches']:
        """Normal forces of the best solution on some bins, shared among patches; `around` is the linear estimate."""
        caused = self._caused(self._by_bin, bins)
        information, evidence = self._evidence(caused, GRANTED * self._regularization / PER_BIN**2, motion, weights)
        shared = self._shared(around)
        held = self._held(shared, self._nearby(shared), HELD * self._regularization) @ self.patches.member[:, bins]
        evidence[: bins.size] -= ON_BINS / PER_BIN**2 * held
        pressed = np.zeros(self.patches.bins.count)
        forces = least_squares(information, evidence, FRICTION, FIRST_STEPS)
        pressed[bins] = forces[: bins.size]
        return self._shared(pressed)

    def _shared(self, on_bins: Float[np.ndarray, ' bins']) -> Float[np.ndarray, ' patches']:
        """Forces on bins, spread evenly over their patches."""
        shared: np.ndarray = on_bins[self.patches.bin_of] / PER_BIN**2
        return shared

    def _summed(self, pressed: Float[np.ndarray, ' patches']) -> Float[np.ndarray, ' bins']:
        """Forces on patches, summed over their bins."""
        return np.bincount(self.patches.bin_of, pressed, self.patches.bins.count)

    @staticmethod
    def _evidence(
        caused: Float32[np.ndarray, 'm rows'], granted: float, motion: Float[np.ndarray, ' rows'], weights: Weights
    ) -> tuple[Float32[np.ndarray, 'm m'], Float32[np.ndarray, ' m']]:
        """Information matrix of the motion on forces (lower half), and its product with the best forces."""
        information = weights.among(caused)
        of_each = np.diag_indices(len(information))
        information[of_each] += np.float32(max(granted, UNSTABLE * float(information[of_each].max())))
        return information, caused @ weights.times(motion.astype(np.float32)[None])[0]

    def motion_under(self, found: Field) -> Float[np.ndarray, ' rows']:
        """Motion of the regions under the forces of a field on its active patches."""
        caused = self._caused(self._by_force, found.active)
        moved: np.ndarray = found.forces_n[:, found.active].reshape(-1).astype(np.float32) @ caused
        return moved

    def hidden(self, pressed: Float[np.ndarray, ' patches']) -> float:
        """How much less visible forces are than on most patches: the ratio minus 1; 0 for usual visibility."""
        shown = float(pressed @ self._shown) / max(float(pressed.sum()), LEAST_N)
        return max(1 / max(shown, LEAST_SHOWN) - 1, 0.0)

    def unknowns(self, patches: int) -> float:
        """About how many forces on so many patches the regions can distinguish: up to three on each."""
        return patches * max(1.0, 3 * self._regularization)

    def unseen_n(self, weights: Weights, gain: float) -> float:
        """The force below which a contact may be reported as zero: it has this gain, or the l1 term suppresses it.

        In a contact of n patches with the force F the term is a penalty of about HELD n log F. Where the gain of the
        motion grows as a F²/2, the best force is F - HELD n / (a F), and there is none for F² < 4 HELD n / a.
        """
        needed = max(gain, 2 * HELD * self._regularization * OF_A_TIP)
        return math.sqrt(2 * needed / max(float(self._usual_squared @ weights.single), 1e-12))

    def reduced_n(self, weights: Weights, total_n: float) -> float:
        """By how much the l1 term reduces the force of such a contact."""
        unseen_n = self.unseen_n(weights, 0.0)
        return min(unseen_n, unseen_n**2 / max(4 * total_n, LEAST_N))

    @cached_property
    def _usual_squared(self) -> Float32[np.ndarray, ' rows']:
        """Squared motion under 1 N on a patch, mean over the gel."""
        usual: np.ndarray = np.square(self._by_force[: self.patches.count][self._on_gel]).mean(axis=0)
        return usual

    @cached_property
    def _shown(self) -> Float[np.ndarray, ' patches']:
        """Motion of the regions per newton on each patch, relative to the usual one.

        A camera that looks straight at thin gel sees less of the motion in the middle, although it sees all of it. So
        the usual motion is that of most patches, or less if no patch nearer to the middle shows more.
        """
        moved = np.linalg.norm(self._by_force[: self.patches.count].astype(float), axis=1)
        outwards = np.argsort(np.linalg.norm(self.patches.centres_mm - self.patches.bins.centre_mm, axis=1))
        nearer = np.empty_like(moved)
        nearer[outwards] = np.maximum.accumulate(moved[outwards])
        usual = np.minimum(nearer, np.median(moved[self._on_gel]))
        share: np.ndarray = moved / np.maximum(usual, 1e-12)  # no patch shows anything if the gel has a hole there
        return share

    @cached_property
    def _on_gel(self) -> Bool[np.ndarray, ' patches']:
        """Patches on which force can act: a response of zero marks a patch outside the gel."""
        return np.asarray(self._by_force[: self.patches.count].any(axis=1))

    @cached_property
    def _by_force(self) -> Float32[np.ndarray, 'unknowns rows']:
        return np.ascontiguousarray(self.response.T)

    @staticmethod
    def _caused(
        by_force: Float32[np.ndarray, 'unknowns rows'], active: Int[np.ndarray, ' n']
    ) -> Float32[np.ndarray, 'm rows']:
        """Motion under 1 N of each force on some patches or bins, one row per force."""
        count = len(by_force) // 3
        rows: np.ndarray = by_force[np.concatenate([active, active + count, active + 2 * count])]
        return rows

    def _nearby(self, pressed: Float[np.ndarray, ' patches']) -> Float[np.ndarray, ' patches']:
        """Mean over each patch and its neighbours."""
        grid = pressed.reshape(self.patches.shape)
        mean: np.ndarray = cv2.blur(grid, (3, 3), borderType=cv2.BORDER_CONSTANT)
        return mean.ravel()

    def _weight_of(self, nearby: Float[np.ndarray, ' patches']) -> float:
        """The weight of the l1 term on chosen patches."""
        return min(HELD * self._regularization, max(self._lightly_held, HELD_PER_N * float(nearby.max())))

    @property
    def _lightly_held(self) -> float:
        return LIGHTLY_HELD * self.doubt**2

    def _held(
        self, pressed: Float[np.ndarray, ' patches'], nearby: Float[np.ndarray, ' patches'], weight: float
    ) -> Float[np.ndarray, ' patches']:
        """The penalty of 1 N on each patch."""
        filled, total = min(1.0, (WIDE / spread_over(pressed)) ** 2), max(float(pressed.sum()), LEAST_N)
        held = weight * filled / (nearby + SPREAD * total)
        return np.asarray(held - CENTRED * (1 - self._regularization) * float(pressed @ held) / total)

    @cached_property
    def _regularization(self) -> float:
        """Share of the regularization that is used: below 1 if there are fewer regions than patches.

        With a few dozen printed dots the full regularization would halve the force.
        """
        return min(1.0, len(self.response) / 2 / max(int(self._on_gel.sum()), 1)) ** 2

    def _nothing(self, motion: np.ndarray, weights: Weights) -> Field:
        none = np.zeros((3, self.patches.count))
        return Field(none, np.zeros(0, int), np.zeros((0, 0)), *self._fit(motion, motion, weights))

    @staticmethod
    def _fit(motion: np.ndarray, left: np.ndarray, weights: Weights) -> tuple[float, float]:
        """Misfit and gain."""
        return _misfit_and_gain(weights.squared(motion), weights.squared(left), len(motion))


def _misfit_and_gain(before: float, after: float, numbers: int) -> tuple[float, float]:
    """Misfit and gain from the squared motion of `numbers` values, and from their squared residual."""
    return math.sqrt(after / max(numbers, 1)), (before - after) / 2
