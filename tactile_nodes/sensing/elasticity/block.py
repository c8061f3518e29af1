"""Finite elements of a rectangular block of gel on a rigid base: bricks of eight nodes.

A brick changes its volume only as a whole (B-bar; Hughes, The Finite Element Method, 1987, ch. 4.5), because trilinear
bricks of an incompressible material are far too stiff otherwise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_nodes.shapes import Float

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

NEARLY = 0.498
"""Poisson's ratio of an incompressible material here; its elements have no pressure of their own."""

CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
POINTS = (2 * CORNERS - 1) / np.sqrt(3)


Lines = tuple[Float[np.ndarray, ' x'], Float[np.ndarray, ' y'], Float[np.ndarray, ' z']]


class Block:
    """A linear elastic block between `lines_mm` along x, y and z; the base is at the first of the last.

    `moduli_mpa` and `poisson_ratios` hold one number for each interval along z. The sides are free, or `held` by rigid
    walls. Unknowns are the displacements of the nodes, in the order (x, y, z, axis).
    """

    def __init__(
        self,
        lines_mm: Lines,
        moduli_mpa: Float[np.ndarray, ' intervals'],
        poisson_ratios: Float[np.ndarray, ' intervals'],
        *,
        held: bool = False,
    ) -> None:
        from scipy.sparse.linalg import splu

        self.lines_mm = lines_mm
        self.shape = tuple(map(len, lines_mm))
        node = np.arange(np.prod(self.shape)).reshape(self.shape)
        fixed = np.zeros(self.shape, bool)
        fixed[:, :, 0] = True
        if held:
            fixed[[0, -1]] = fixed[:, [0, -1]] = True
        self._free = (3 * node[~fixed][:, None] + np.arange(3)).reshape(-1)
        matrix = self._matrix(node, moduli_mpa, np.minimum(poisson_ratios, NEARLY))[self._free][:, self._free]
        # Symmetric and positive definite: no pivoting, and an ordering for that.
        self._solver = splu(matrix, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options={'SymmetricMode': True})

    def moved_mm(self, force_n: Float[np.ndarray, 'unknowns loads']) -> Float[np.ndarray, 'unknowns loads']:
        """Displacements under forces on the nodes."""
        moved = np.zeros_like(force_n)
        moved[self._free] = self._solver.solve(np.ascontiguousarray(force_n[self._free]))
        return moved

    def _matrix(self, node: np.ndarray, moduli_mpa: np.ndarray, poisson_ratios: np.ndarray) -> csc_matrix:
        """The stiffness matrix, in N/mm."""
        from scipy.sparse import coo_matrix

        sides = np.meshgrid(*(np.diff(each) for each in self.lines_mm), indexing='ij')
        size = np.stack([each.ravel() for each in sides], -1)
        at = np.indices(sides[0].shape).reshape(3, -1)
        corner = node[tuple(at[:, :, None] + CORNERS.T[:, None])]
        modulus, ratio = (each[at[2]] for each in (moduli_mpa, poisson_ratios))
        stiffness = _bricks(size, modulus, 2 * modulus * ratio / (1 - 2 * ratio))
        unknown = (3 * corner[:, :, None] + np.arange(3)).reshape(len(size), 24)
        rows, cols = np.repeat(unknown, 24, axis=1).ravel(), np.tile(unknown, (1, 24)).ravel()
        matrix: csc_matrix = coo_matrix((stiffness.ravel(), (rows, cols)), shape=(3 * node.size,) * 2).tocsc()
        return matrix


def _bricks(
    size_mm: Float[np.ndarray, 'bricks 3'], modulus: Float[np.ndarray, ' bricks'], lame: Float[np.ndarray, ' bricks']
) -> Float[np.ndarray, 'bricks 24 24']:
    """Stiffness of bricks; modulus and Lamé's first parameter in MPa."""
    mean = _slopes(np.zeros(3))[None] / size_mm[:, None]
    volume = size_mm.prod(axis=1)
    found = np.einsum('e,eai,ebj->eaibj', lame * volume, mean, mean)
    for point in POINTS:
        slopes = _slopes(point)[None] / size_mm[:, None]
        share = (modulus * volume / len(POINTS))[:, None, None]
        # 2 G e:e without the volume change of the point, which that of the middle replaces.
        apart = (mean - slopes) / 3
        product = np.einsum('eak,ebk->eab', share * slopes, slopes)
        for axis in range(3):
            found[:, :, axis, :, axis] += product
        found += np.einsum('eaj,ebi->eaibj', share * slopes, slopes)
        for one, other in ((slopes, apart), (apart, slopes)):
            found += 2 * np.einsum('eai,ebj->eaibj', share * one, other)
        found += 6 * np.einsum('eai,ebj->eaibj', share * apart, apart)
    bricks: np.ndarray = found.reshape(-1, 24, 24)
    return bricks


def _slopes(point: Float[np.ndarray, ' 3']) -> Float[np.ndarray, '8 3']:
    """Derivatives of the shape functions along each axis, times the side, at a point from -1 to 1 along each."""
    signs = 2 * CORNERS - 1
    values = (1 + signs * point) / 2
    slopes = np.empty((8, 3))
    for axis in range(3):
        slopes[:, axis] = signs[:, axis] * np.delete(values, axis, axis=1).prod(axis=1)
    return slopes
