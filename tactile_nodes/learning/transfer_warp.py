"""One gel's response told by another's: each region looks at another place of the surface, and sees it in proportion.

A soft layer answers a press alike wherever it is, so a region that sees another part of the surface (a camera shifted,
turned, tilted, nearer) shows what it would have shown of a press at another place. Of a press at p with the force F a
region r of the new gel shows A_r m_r(B p + d_r, f(F)), where m_r is the source's response. So no image is resampled;
the numbers of A, B, d and f are found by nonlinear least squares on whole fields of motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32

from tactile_nodes.sensing.response import Response, ResponseReadout
from tactile_nodes.sensing.splines import SplineAxis

MOST_STEPS = 10
CONVERGED = 1e-4
"""Share of the cost: steps end where none gains more."""
MODEL_SHARE = 0.1
"""What of a field of motion a warp is not expected to tell: beside it noise counts little."""
FIRST_DAMPING, LAST_DAMPING = 1e-3, 1e5
SIGMA_FORCE, SIGMA_TURN, SIGMA_MOTION, SIGMA_AWAY_MM = 0.5, 0.1, 0.2, 1.0
SIGMA_OFFSET_N = 1.0
"""How far from those of an equal gel the numbers may be expected to be."""


@dataclass(frozen=True)
class SourceField:
    """A response as motion of regions (px) instead of components, and where the regions are in the image (-1 to 1)."""

    axes: tuple[SplineAxis, SplineAxis, SplineAxis]
    power: float
    coefficients: Float32[np.ndarray, 'regions nx ny ns 2']
    places: Float[np.ndarray, 'regions 2']
    gain: Float[np.ndarray, 'regions 2']

    @classmethod
    def of(cls, readout: ResponseReadout) -> SourceField:
        """The field of a readout of Cartesian motion; regions that it does not trust have none."""
        response: Response = readout.response
        rows, cols, _ = readout.scaling.mean.shape
        back = np.linalg.inv(readout.whitening.astype(float)).T @ readout.likeness.directions.astype(float)
        back /= readout.scaling.gain.reshape(-1)
        table = response.coefficients.reshape(-1, len(back)).astype(float) @ back
        shape = (*(axis.count for axis in response.axes), rows * cols, 2)
        v, u = np.meshgrid(*((2 * np.arange(count) + 1) / count - 1 for count in (rows, cols)), indexing='ij')
        return cls(
            response.axes,
            response.power,
            np.ascontiguousarray(np.moveaxis(table.reshape(shape), 3, 0), np.float32),
            np.column_stack([u.ravel(), v.ravel()]),
            readout.scaling.gain.reshape(-1, 2).astype(float),
        )

    def motion(self, at: Float[np.ndarray, 'n regions 3']) -> Float[np.ndarray, 'n regions 2']:
        """Motion where each region has a place and s of its own; straight on beyond what the source knows."""
        if self._beyond(at).any():
            return np.asarray(self.slopes(at)[0])
        block, (x, y, s) = self._around(at)
        weights = (x[0][..., :, None, None] * y[0][..., None, :, None] * s[0][..., None, None, :]).astype(np.float32)
        found: np.ndarray = weights.reshape(*at.shape[:2], 1, 64) @ block.reshape(*at.shape[:2], 64, 2)
        return np.asarray(found[..., 0, :], float)

    def _beyond(self, at: np.ndarray) -> np.ndarray:
        low, high = np.array([axis.low for axis in self.axes]), np.array([axis.high for axis in self.axes])
        return np.asarray(at - np.clip(at, low, high))

    def _around(self, at: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """The coefficients that count at each place, and the splines' values and slopes."""
        (i, x), (j, y), (k, s) = (_weights(axis, at[..., column]) for column, axis in enumerate(self.axes))
        region, four = np.arange(at.shape[1])[None, :, None, None, None], np.arange(4)
        block = self.coefficients[
            region,
            (i[..., None] + four)[..., :, None, None],
            (j[..., None] + four)[..., None, :, None],
            (k[..., None] + four)[..., None, None, :],
        ]
        return block, [x, y, s]

    def slopes(self, at: Float[np.ndarray, 'n regions 3']) -> Float[np.ndarray, '4 n regions 2']:
        """Motion as above, and its slopes along x, y and s."""
        block, (x, y, s) = self._around(at)
        of_s = np.einsum('nrijkc,gnrk->gnrijc', block, s, optimize=True)
        of_y = np.einsum('nrijc,gnrj->gnric', of_s[0], y, optimize=True)
        value, along_x = np.einsum('nric,gnri->gnrc', of_y[0], x, optimize=True)
        along_y = np.einsum('nric,nri->nrc', of_y[1], x[0])
        along_s = np.einsum('nrijc,nri,nrj->nrc', of_s[1], x[0], y[0], optimize=True)
        along = np.stack([along_x, along_y, along_s])
        value = value + np.einsum('gnrc,nrg->nrc', along, self._beyond(at))
        return np.concatenate([value[None], along])


def _weights(axis: SplineAxis, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `SplineAxis.weights`, of many values: numbers of the first splines, and (2, ..., 4) values and slopes."""
    step = (axis.high - axis.low) / axis.intervals
    along = (np.clip(values, axis.low, axis.high) - axis.low) / step
    first = np.minimum(along.astype(int), axis.intervals - 1)
    t = along - first
    u = 1 - t
    value = [u**3 / 6, (4 - 6 * t**2 + 3 * t**3) / 6, (4 - 6 * u**2 + 3 * u**3) / 6, t**3 / 6]
    slope = [-(u**2) / 2, (3 * t**2 - 4 * t) / 2, (4 * u - 3 * u**2) / 2, t**2 / 2]
    return first, np.stack([np.stack(value, -1), np.stack(slope, -1) / step])


@dataclass(frozen=True)
class Pairs:
    """Presses on the new gel, the motion that they caused (px, regions), and how much each number counts.

    `presses` are x, y (mm) and F (N). Weights are 1 over the expected deviation; 0 where nothing is known.
    """

    presses: Float[np.ndarray, 'n 3']
    motion: Float[np.ndarray, 'n regions 2']
    weight: Float[np.ndarray, 'n regions 2']

    @classmethod
    def of(cls, presses: np.ndarray, motion: np.ndarray, seen: np.ndarray, gain: np.ndarray) -> Pairs:
        """Weights of noise and of a share of each field's size; `seen` (n, regions) says what could be followed."""
        known = gain * seen[..., None]
        size = np.sqrt(((motion * known) ** 2).sum(axis=(1, 2)) / np.maximum(seen.sum(axis=1) * 2, 1))
        return cls(presses, motion, known / np.sqrt(1 + (MODEL_SHARE * size[:, None, None]) ** 2))

    def __len__(self) -> int:
        return len(self.presses)

    def take(self, chosen: np.ndarray) -> Pairs:
        """Some of the presses."""
        return Pairs(self.presses[chosen], self.motion[chosen], self.weight[chosen])


@dataclass(frozen=True)
class Warp:
    """How the new gel's response follows from the source's; see the head of this file. f(F) = (gain F)^power."""

    gain: float
    turn: Float[np.ndarray, '2 2']
    motion: Float[np.ndarray, 'regions 2 2']
    away_mm: Float[np.ndarray, 'regions 2']

    @classmethod
    def none(cls, regions: int) -> Warp:
        """That of an equal gel."""
        return cls(1.0, np.eye(2), np.tile(np.eye(2), (regions, 1, 1)), np.zeros((regions, 2)))

    def source_places(self, field: SourceField, presses: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions 3']:
        """Where and how hard the source would have to be pressed, for each region."""
        place = (presses[:, :2] @ self.turn.T)[:, None] + self.away_mm
        force = np.maximum(self.gain * presses[:, 2], 0.0) ** field.power
        return np.concatenate([place, np.broadcast_to(force[:, None, None], (*place.shape[:2], 1))], axis=-1)

    def slopes(self, field: SourceField, presses: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, '5 n regions 2']:
        """Motion of the new gel, its slopes along the source's x, y and s, and the source's motion itself."""
        own = field.slopes(self.source_places(field, presses))
        return np.concatenate([np.einsum('rab,gnrb->gnra', self.motion, own), own[:1]])

    def predict(self, field: SourceField, presses: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions 2']:
        """Motion of the new gel under presses."""
        own = field.motion(self.source_places(field, presses))
        predicted: np.ndarray = np.einsum('rab,nrb->nra', self.motion, own)
        return predicted


@dataclass(frozen=True)
class _Form:
    """Which numbers are free: of 'gain' those of force and motion (2), of 'affine' all that are linear (15)."""

    away: Float[np.ndarray, 'terms regions']
    affine: bool

    @classmethod
    def named(cls, form: str, places: Float[np.ndarray, 'regions 2']) -> _Form:
        linear = np.vstack([np.ones(len(places)), places.T])
        return cls(linear if form == 'affine' else linear[:0], form == 'affine')

    @property
    def sigma(self) -> np.ndarray:
        sizes = [
            (1, SIGMA_FORCE), (4 * self.affine, SIGMA_TURN), (4 if self.affine else 1, SIGMA_MOTION),
            (2 * len(self.away), SIGMA_AWAY_MM),
        ]  # fmt: skip
        return np.concatenate([np.full(count, sigma) for count, sigma in sizes])

    def warp(self, numbers: np.ndarray) -> Warp:
        gain, turn, motion, away = np.split(numbers, np.cumsum([1, 4 * self.affine, 4 if self.affine else 1]))
        turned = np.eye(2) + (turn.reshape(2, 2) if self.affine else 0.0)
        seen = np.eye(2) + (motion.reshape(2, 2) if self.affine else motion * np.eye(2))
        moved = self.away.T @ away.reshape(-1, 2)
        return Warp(math.exp(gain[0]), turned, np.tile(seen, (self.away.shape[1], 1, 1)), moved)

    def slopes(self, field: SourceField, warp: Warp, presses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motion (n, regions, 2), and how it changes with every number (numbers, n, regions, 2)."""
        value, x, y, s, own = warp.slopes(field, presses)
        found = [s * (field.power * np.maximum(warp.gain * presses[:, 2], 0.0) ** field.power)[:, None, None]]
        if self.affine:
            found += [along * presses[:, column, None, None] for along in (x, y) for column in (0, 1)]
            found += [_into(a, own[..., b]) for a in (0, 1) for b in (0, 1)]
        else:
            found += [own]
        found += [along * term[:, None] for term in self.away for along in (x, y)]
        return value, np.stack(found)


def _into(channel: int, values: np.ndarray) -> np.ndarray:
    both = np.zeros((*values.shape, 2))
    both[..., channel] = values
    return both


def fit_warp(field: SourceField, pairs: Pairs, form: str, begin: np.ndarray | None = None) -> tuple[Warp, np.ndarray]:
    """The warp of a form that explains the pairs best, and its numbers; Levenberg's and Marquardt's steps.

    `begin` may be the numbers of a fit to other presses.
    """
    shape = _Form.named(form, field.places)
    sigma = shape.sigma
    here = np.zeros(len(sigma)) if begin is None else begin
    damping, cost, (square, down) = FIRST_DAMPING, *_normal(field, shape, pairs, here)
    for _ in range(MOST_STEPS):
        while damping < LAST_DAMPING:
            step = np.linalg.solve(square + damping * np.diag(np.diag(square)), down)
            further, normal = _normal(field, shape, pairs, here + step)
            if further < cost:
                break
            damping *= 10
        else:
            break
        gained, here, cost, (square, down) = cost - further, here + step, further, normal
        damping = max(damping / 10, 1e-9)
        if gained < CONVERGED * cost:
            break
    return shape.warp(here), here


def _normal(
    field: SourceField, shape: _Form, pairs: Pairs, numbers: np.ndarray
) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    """Cost, and the normal equations of the next step."""
    value, slopes = shape.slopes(field, shape.warp(numbers), pairs.presses)
    left = ((pairs.motion - value) * pairs.weight).ravel()
    lever = (slopes * pairs.weight).reshape(len(slopes), -1)
    prior = 1 / shape.sigma**2
    cost = float(left @ left + prior @ numbers**2)
    return cost, (lever @ lever.T + np.diag(prior), lever @ left - prior * numbers)


def force_offset(field: SourceField, pairs: Pairs) -> float:
    """The force (N) that the presses' forces seem to begin at: one more number in the step of the affine warp."""
    shape = _Form.named('affine', field.places)
    warp, numbers = fit_warp(field, pairs, 'affine')
    value, slopes = shape.slopes(field, warp, pairs.presses)
    by_offset = -slopes[0] / np.maximum(pairs.presses[:, 2], 1e-3)[:, None, None]
    lever = (np.concatenate([slopes, by_offset[None]]) * pairs.weight).reshape(len(numbers) + 1, -1)
    prior = 1 / np.append(shape.sigma, SIGMA_OFFSET_N) ** 2
    down = lever @ ((pairs.motion - value) * pairs.weight).ravel() - prior * np.append(numbers, 0.0)
    return float(np.linalg.solve(lever @ lever.T + np.diag(prior), down)[-1])


def with_regions(
    field: SourceField, warp: Warp, pairs: Pairs, motion_sigma: float, away_sigma_mm: float, steps: int = 2
) -> Warp:
    """The warp with every region's own deviation: its markers lie a little aside, or higher, than the source's.

    Six numbers a region, held near zero by what deviations may be expected (`motion_sigma`, `away_sigma_mm`).
    """
    prior = 1 / np.array([motion_sigma] * 4 + [away_sigma_mm] * 2) ** 2
    start = warp
    for _ in range(steps):
        value, x, y, _, own = warp.slopes(field, pairs.presses)
        levers = np.stack([_into(a, own[..., b]) for a in (0, 1) for b in (0, 1)] + [x, y]) * pairs.weight
        left = (pairs.motion - value) * pairs.weight
        square = np.einsum('inrc,jnrc->rij', levers, levers, optimize=True) + np.diag(prior)
        gone = np.concatenate([(warp.motion - start.motion).reshape(-1, 4), warp.away_mm - start.away_mm], axis=1)
        down = np.einsum('inrc,nrc->ri', levers, left, optimize=True) - prior * gone
        step = np.linalg.solve(square, down[..., None])[..., 0]
        warp = replace(warp, motion=warp.motion + step[:, :4].reshape(-1, 2, 2), away_mm=warp.away_mm + step[:, 4:])
    return warp
