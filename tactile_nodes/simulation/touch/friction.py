"""Contact of a surface with a rigid body under Coulomb friction, with the surface's linear compliance.

The solution are forces on the surface's nodes with these properties. A node either has a gap and no force, or no gap
and a pressing force. The tangential force is at most the friction coefficient times the pressing force; at that limit
it opposes the slip, below it there is no slip. The fixed point of the alternating direction method of multipliers has
these properties if the projection on the cone treats the normal force first and then the tangential force. Its linear
half takes one forward and one inverse transform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft

from tactile_nodes.shapes import Complex, Float

OVER_RELAXATION = 1.6
ITERATIONS = 30

Vectors = Float[np.ndarray, '3 y x']


@dataclass(frozen=True)
class Gap:
    """The surface relative to the body if the forces stayed as they are.

    `normal` points out of the body, into the gel. `apart` is the gap along it (negative: penetration). `slip` is how
    far each node has moved over the body, in the tangent plane (0 for nodes that did not touch before).
    """

    normal: Vectors
    apart: Float[np.ndarray, 'y x']
    slip: Vectors


class Surface:
    """Computes contact forces from gaps, with the compliance of the surface's nodes."""

    def __init__(self, compliance: Complex[np.ndarray, 'ky kx 3 3']) -> None:
        self._compliance = compliance
        self._cells = compliance.shape[0]
        sizes = np.abs(compliance[..., 0, 0])
        self._step = float(np.sqrt(np.median(sizes) * sizes.max()))
        self._prepared = np.linalg.inv(compliance + self._step * np.eye(3))

    def forces(self, before: Vectors, gap: Gap, friction: float, total: float | None = None) -> tuple[Vectors, Vectors]:
        """Forces on the nodes after a few more iterations, and the motion over the body that they leave.

        `before` are the forces at which the gap was computed. With `total`, the wanted sum of forces into the gel, the
        body may also move up or down; this needs an existing contact.
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
    """Project forces on the friction cone: their pressing part, and as much of the tangential part as friction allows.

    (3, 0, 1) on a body whose normal is z, with a friction coefficient of 0.5, becomes (0.5, 0, 1).
    """
    along = (force * normal).sum(axis=0)
    pressing = np.maximum(along, 0.0)
    aside = force - normal * along
    size = np.sqrt((aside * aside).sum(axis=0))
    share = np.minimum(1.0, friction * pressing / np.maximum(size, 1e-12))
    allowed: np.ndarray = normal * pressing + aside * share
    return allowed
