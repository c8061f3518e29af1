"""The force field that explains how regions move: normal force and shear on patches of the surface.

Least squares under p >= 0 and |q| <= p: first on those bins in which a linear answer finds force, then on the patches
around which there is some. Where markers lie near the surface, regions see what is smaller than a bin, and the linear
answer looks in the wrong bins: there all bins are tried, and what is found is solved for again. A uniform pressure on
an incompressible layer moves next to nothing, so that any smear of it would fit: a reweighted l1 term holds a patch
down the more, the less force there is around it, and less where the contact is wide. What the camera itself moved by is
found with the forces. Which region counts how much is in `tactile_nodes.sensing.explain.field.weights`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.elasticity.patches import PER_BIN, PatchGrid
from tactile_nodes.sensing.explain.field.cone import NOT_APART, STEPS, inverse_root, least_squares
from tactile_nodes.sensing.explain.field.weights import Weights, region_weights

FRICTION = 1.0
"""No rubber on skin holds more shear than this share of the pressure for long; a bound, not an estimate."""

HELD, SPREAD = 7.0, 0.003
"""Weight of a reweighted l1 term, which holds patches down, and the share of the whole force that counts as being
around every patch."""

WIDE = 20.0
"""Patches over which the force spreads from which a contact is wide: the middle of such a one shows next to nothing and
is filled rather than held down, by so much less as the square of their number says."""

UNSEEN_N = 0.012
"""What noise allows to be on a patch whose force is told as none."""

ON_BINS, FIRST_STEPS = 2.0, 10
"""How much more bins are held down than patches, and steps of the solver on them: all that comes of it is which patches
are solved on, and what holds them down."""

GRANTED = 50.0
"""Weight of a ridge term (1/N²), which holds all forces: none is some hundred mN for nothing."""

COARSE = 300.0
"""The same for the linear answer on bins."""

UNSTABLE = 3e-6
"""The least of it as a share of what is known best of any force: 32 bit floats tell no smaller ones apart."""

EVEN_N = 0.1
"""Force on each bin where nothing is known of where forces act."""

LEAST_SHOWN = 0.1
"""Of what is usual: forces that show less are told so seldom that no more needs to be said."""

ACTIVE, LEAST_N = 0.05, 1e-3
"""Bins are solved on that hold this share of the strongest bin's force, and so much; then patches around which there is
this share of what is around any."""


@dataclass(frozen=True)
class Field:
    """Forces on patches (N): into the gel, along x, along y; and what is known of how far they are off.

    `active` are the patches that were solved on; with `root` R, R'R is the covariance of their forces, first all normal
    ones, then along x, then along y. `misfit` is the root mean square of what is left over, in units of what is
    expected; `gain` how much more probable these forces are than none (half the fall of the squared misfit).
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
        """How far the force is spread beyond a contact of which all is seen: 0, to 1 where it is twice as wide."""
        return min(max(spread_over(self.forces_n[0]) / WIDE - 1, 0.0), 1.0)

    def deviations(self, levers: Float[np.ndarray, 'm sums']) -> Float[np.ndarray, ' sums']:
        """Standard deviations of sums of the active patches' forces, or of the first of them, each times its lever."""
        each = self.root[:, : len(levers)] @ levers.astype(self.root.dtype)
        deviations: np.ndarray = np.sqrt(np.einsum('ms,ms->s', each, each)).astype(float)
        return deviations


def spread_over(pressed: Float[np.ndarray, ' patches']) -> float:
    """On how many patches an even force would be as much spread: 1 of one patch, n of n alike; noise is left out."""
    above = np.maximum(pressed - UNSEEN_N / 2, 0.0)
    return max(float(above.sum()) ** 2 / max(float(above @ above), 1e-12), 1.0)


@dataclass(frozen=True)
class FieldSolver:
    """Motion of regions to forces on patches.

    `response` is the motion (px) of the known regions, along x and y, under 1 N on each patch: normal, along x, along
    y; `camera` their motion as the camera moves as far as is usual. `noise_px` is the least that a region moves by
    itself, `doubt` the share of its motion that the response may be off by. `passes`: how often a frame is solved; with
    more than one it begins on all bins, and each pass on what the one before found.
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
        """How much each region counts in a frame of such noise, along x and along y, beside what the camera moves."""
        noise_px = max(noise_px, self.noise_px)
        return Weights.of(region_weights(motion, confidence, noise_px, self.doubt), self.camera)

    @cached_property
    def _by_bin(self) -> Float32[np.ndarray, 'unknowns rows']:
        """What 1 N of each force moves, even over a bin."""
        member = self.patches.member * self._on_gel[:, None]
        member /= np.maximum(member.sum(axis=0), 1)
        by_bin = [member.T @ part for part in np.split(self.response.T.astype(float), 3)]
        return np.concatenate(by_bin).astype(np.float32)

    @cached_property
    def _coarse(self) -> Float32[np.ndarray, 'bins rows']:
        """The linear answer of normal forces on bins to motion of usual noise; what the camera moves is left out."""
        on_bins = self._by_bin.astype(float)
        even = Weights.of(np.full(on_bins.shape[1] // 2, self.noise_px**-2), self.camera).times(on_bins)
        solved: np.ndarray = np.linalg.solve(even @ on_bins.T + COARSE * np.eye(len(even)), even)
        return solved[: self.patches.bins.count].astype(np.float32)

    def coarse(self, motion: Float[np.ndarray, 'regions 2']) -> Float[np.ndarray, ' bins']:
        """Normal forces on bins by one matrix, none below 0."""
        answer: np.ndarray = self._coarse @ motion.reshape(-1).astype(np.float32)
        pressed: np.ndarray = np.maximum(answer, 0.0, dtype=float)
        return pressed

    def field(
        self,
        motion: Float[np.ndarray, 'regions 2'],
        weights: Weights,
        coarse: Float[np.ndarray, ' bins'] | None = None,
    ) -> Field:
        """The field that explains a motion best; `coarse` is the answer on bins, where it is known already."""
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
        """The best field on those bins around which there is force."""
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
        information, evidence = self._evidence(caused, GRANTED * self._told, motion, weights)
        evidence[: active.size] -= self._held(pressed)[active]
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
            self.patches.shape[1], self._told,
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
        """The normal force of the best answer on some bins, as each patch has its share; `around` is the linear one."""
        caused = self._caused(self._by_bin, bins)
        information, evidence = self._evidence(caused, GRANTED * self._told / PER_BIN**2, motion, weights)
        held = self._held(self._shared(around)) @ self.patches.member[:, bins]
        evidence[: bins.size] -= ON_BINS / PER_BIN**2 * held
        pressed = np.zeros(self.patches.bins.count)
        forces = least_squares(information, evidence, FRICTION, FIRST_STEPS)
        pressed[bins] = forces[: bins.size]
        return self._shared(pressed)

    def _shared(self, on_bins: Float[np.ndarray, ' bins']) -> Float[np.ndarray, ' patches']:
        """Forces on bins as even ones on their patches."""
        shared: np.ndarray = on_bins[self.patches.bin_of] / PER_BIN**2
        return shared

    def _summed(self, pressed: Float[np.ndarray, ' patches']) -> Float[np.ndarray, ' bins']:
        """Forces on patches as those on their bins."""
        return np.bincount(self.patches.bin_of, pressed, self.patches.bins.count)

    @staticmethod
    def _evidence(
        caused: Float32[np.ndarray, 'm rows'], granted: float, motion: Float[np.ndarray, ' rows'], weights: Weights
    ) -> tuple[Float32[np.ndarray, 'm m'], Float32[np.ndarray, ' m']]:
        """What the motion says of forces: its information on them (the lower half), and that times the best ones."""
        information = weights.among(caused)
        of_each = np.diag_indices(len(information))
        information[of_each] += np.float32(max(granted, UNSTABLE * float(information[of_each].max())))
        return information, caused @ weights.times(motion.astype(np.float32)[None])[0]

    def hidden(self, pressed: Float[np.ndarray, ' patches']) -> float:
        """How many times less forces show in the picture than on most patches, beside 1; 0 of what shows as well."""
        shown = float(pressed @ self._shown) / max(float(pressed.sum()), LEAST_N)
        return max(1 / max(shown, LEAST_SHOWN) - 1, 0.0)

    def unseen_n(self, weights: Weights, gain: float) -> float:
        """The force on a usual patch that would gain so much: up to that it may hide in the noise."""
        return math.sqrt(2 * gain / max(float(self._usual_squared @ weights.single), 1e-12))

    @cached_property
    def _usual_squared(self) -> Float32[np.ndarray, ' rows']:
        """Square of what 1 N on a patch moves, mean over the gel."""
        usual: np.ndarray = np.square(self._by_force[: self.patches.count][self._on_gel]).mean(axis=0)
        return usual

    @cached_property
    def _shown(self) -> Float[np.ndarray, ' patches']:
        """How much a newton on each patch moves the regions, beside what is usual."""
        moved = np.linalg.norm(self._by_force[: self.patches.count].astype(float), axis=1)
        share: np.ndarray = moved / np.median(moved[self._on_gel])
        return share

    @cached_property
    def _on_gel(self) -> Bool[np.ndarray, ' patches']:
        """On which patches force can act: a response of nothing at all says that a patch is beside the gel."""
        return np.asarray(self._by_force[: self.patches.count].any(axis=1))

    @cached_property
    def _by_force(self) -> Float32[np.ndarray, 'unknowns rows']:
        return np.ascontiguousarray(self.response.T)

    @staticmethod
    def _caused(
        by_force: Float32[np.ndarray, 'unknowns rows'], active: Int[np.ndarray, ' n']
    ) -> Float32[np.ndarray, 'm rows']:
        """What 1 N of each force on some patches or bins moves: a row a force."""
        count = len(by_force) // 3
        rows: np.ndarray = by_force[np.concatenate([active, active + count, active + 2 * count])]
        return rows

    def _nearby(self, pressed: Float[np.ndarray, ' patches']) -> Float[np.ndarray, ' patches']:
        """Mean over each patch and its neighbours."""
        grid = pressed.reshape(self.patches.shape)
        mean: np.ndarray = cv2.blur(grid, (3, 3), borderType=cv2.BORDER_CONSTANT)
        return mean.ravel()

    def _held(self, pressed: Float[np.ndarray, ' patches']) -> Float[np.ndarray, ' patches']:
        filled = min(1.0, (WIDE / spread_over(pressed)) ** 2)
        return HELD * self._told * filled / (self._nearby(pressed) + SPREAD * max(float(pressed.sum()), LEAST_N))

    @cached_property
    def _told(self) -> float:
        """Share of the weights that hold forces and patches down: less than all where fewer regions than patches tell.

        Of a few dozen printed dots all of it would hold down half of what presses.
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
    """From the squares of so many numbers, and of what is left of them."""
    return math.sqrt(after / max(numbers, 1)), (before - after) / 2
