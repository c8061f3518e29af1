"""Contact of a surface with a rigid body under Coulomb's friction, on the surface's linear compliance.

What is sought are forces on the surface's nodes such that, with w the motion of the surface relative to the body that
they leave, each node either has no force and a gap, or has no gap and a pressing force with a tangential part that is
within the friction coefficient times it; at that limit it opposes the slip, below it there is none. The fixed point of
the alternating direction method of multipliers has just these properties when the cone is projected on normal force
first and then tangential force; its linear half is one transform there and one back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

OVER_RELAXATION = 1.6
ITERATIONS = 30

Vectors = Float[np.ndarray, '3 y x']


@dataclass(frozen=True)
class Gap:
    """The surface relative to the body were forces to stay as they are.

    `normal` points out of the body, into the gel; `apart` is the gap along it (negative: the gel lies in the body);
    `slip` is how far each node has moved over the body, in the plane that touches it (0 where it did not touch before).
    """

    normal: Vectors
    apart: Float[np.ndarray, 'y x']
    slip: Vectors


class Surface:
    """Forces for gaps, by the compliance of the surface's nodes to forces on them."""

    def __init__(self, compliance: Complex[np.ndarray, 'ky kx 3 3']) -> None:
        self._compliance = compliance
        self._cells = compliance.shape[0]
        sizes = np.abs(compliance[..., 0, 0])
        self._step = float(np.sqrt(np.median(sizes) * sizes.max()))
        self._prepared = np.linalg.inv(compliance + self._step * np.eye(3))

    def forces(self, before: Vectors, gap: Gap, friction: float, total: float | None = None) -> tuple[Vectors, Vectors]:
        """Forces on the nodes, a few iterations nearer to the answer, and the motion over the body that they leave.

        `before` are the forces at which the gap was taken. With `total`, the wanted sum of forces into the gel, the
        body may move up or down, which is in no gap; that works where it touches already.
        """
        gaps = gap.normal * gap.apart + gap.slip
        free = self._there(gaps) - self._times(self._compliance, self._there(before))
        found, left = before, -gaps / self._step
        for _ in range(ITERATIONS):
            waves = self._times(self._prepared, self._step * self._there(found - left) - free)
            if total is not None:
                waves[2, 0, 0] = -total
            even = OVER_RELAXATION * self._back(waves) + (1 - OVER_RELAXATION) * found
            found = within_cone(even + left, gap.normal, friction)
            left = left + even - found
        return found, self._back(self._times(self._compliance, self._there(found - before))) + gaps

    @staticmethod
    def _times(matrix: np.ndarray, waves: np.ndarray) -> np.ndarray:
        product: np.ndarray = np.einsum('yxij,jyx->iyx', matrix, waves)
        return product

    @staticmethod
    def _there(values: np.ndarray) -> np.ndarray:
        waves: np.ndarray = scipy.fft.rfft2(values)
        return waves

    def _back(self, waves: np.ndarray) -> np.ndarray:
        values: np.ndarray = scipy.fft.irfft2(waves, s=(self._cells, self._cells))
        return values


def within_cone(force: Vectors, normal: Vectors, friction: float) -> Vectors:
    """The pressing part of forces, and of their tangential part as much as friction lets them have.

    (3, 0, 1) on a body whose normal is z, with a friction coefficient of 0.5, becomes (0.5, 0, 1).
    """
    along = (force * normal).sum(axis=0)
    pressing = np.maximum(along, 0.0)
    aside = force - normal * along
    size = np.sqrt((aside * aside).sum(axis=0))
    share = np.minimum(1.0, friction * pressing / np.maximum(size, 1e-12))
    allowed: np.ndarray = normal * pressing + aside * share
    return allowed
