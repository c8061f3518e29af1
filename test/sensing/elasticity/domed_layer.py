"""A domed layer on a flat rigid base, in finite elements of its own: axially symmetric, linear, nine nodes each."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

GAUSS, WEIGHT = np.polynomial.legendre.leggauss(3)


def _parabolas(x: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2]), np.array([x - 0.5, -2 * x, x + 0.5])


class DomedLayer:
    """A layer whose surface is at `height(r)` (mm, 0 in the middle) over a base at -`thickness_mm`.

    Its rim at `reach_mm` is held fast; so far out it is felt no more.
    """

    def __init__(self, thickness_mm, height, modulus_mpa, poisson, reach_mm=24.0, columns=96, rows=10):
        self._radii, self._share = np.linspace(0, reach_mm, 2 * columns + 1), np.linspace(0, 1, 2 * rows + 1)
        self._thickness, self._height = thickness_mm, height
        surface = height(self._radii)
        r, s = np.meshgrid(self._radii, self._share, indexing='ij')
        z = -thickness_mm + s * (surface[:, None] + thickness_mm)
        self._place = np.stack([r, z], -1).reshape(-1, 2)
        up = 2 * rows + 1
        i, j = (each.ravel() for each in np.meshgrid(np.arange(columns), np.arange(rows), indexing='ij'))
        near = np.arange(3)
        self._nodes = ((2 * i[:, None, None] + near[:, None]) * up + 2 * j[:, None, None] + near).reshape(-1, 9)
        lame = 2 * modulus_mpa * poisson / (1 - 2 * poisson)
        elastic = np.full((4, 4), 0.0)
        elastic[:3, :3] = lame
        elastic[range(3), range(3)] += 2 * modulus_mpa
        elastic[3, 3] = modulus_mpa
        self._stiffness = self._assembled(elastic)
        held = (r == reach_mm) | (s == 0)
        fast = np.repeat(held.ravel(), 2)
        fast[0::2] |= (r == 0).ravel()
        self._free, self._up = np.flatnonzero(~fast), up

    def _assembled(self, elastic):
        """The stiffness of the whole layer, of strains rr, zz, hoop, rz."""
        count = len(self._nodes)
        of_each, corners = np.zeros((count, 18, 18)), self._place[self._nodes]
        for x, at_x in zip(GAUSS, WEIGHT, strict=True):
            for y, at_y in zip(GAUSS, WEIGHT, strict=True):
                (one, one_slope), (two, two_slope) = _parabolas(x), _parabolas(y)
                value = np.outer(one, two).ravel()
                slopes = np.stack([np.outer(one_slope, two).ravel(), np.outer(one, two_slope).ravel()])
                jacobian = np.einsum('an,end->ead', slopes, corners)
                along = np.einsum('eda,an->edn', np.linalg.inv(jacobian), slopes)
                radius = corners[..., 0] @ value
                strain = np.zeros((count, 4, 18))
                strain[:, 0, 0::2], strain[:, 1, 1::2] = along[:, 0], along[:, 1]
                strain[:, 2, 0::2] = value / radius[:, None]
                strain[:, 3, 0::2], strain[:, 3, 1::2] = along[:, 1], along[:, 0]
                volume = 2 * np.pi * radius * np.linalg.det(jacobian) * at_x * at_y
                of_each += volume[:, None, None] * (strain.transpose(0, 2, 1) @ elastic @ strain)
        numbers = (2 * self._nodes[:, :, None] + np.arange(2)).reshape(count, 18)
        row, column = np.repeat(numbers, 18, axis=1).ravel(), np.tile(numbers, (1, 18)).ravel()
        size = 2 * len(self._place)
        return coo_matrix((of_each.ravel(), (row, column)), (size, size)).tocsc()

    def pressed(self, pressure):
        """Displacements along r and z, as functions of (r, depth below the surface), under `pressure(r)` straight down,
        in newtons a square millimetre of the plane."""
        load = np.zeros((2 * len(self._radii), 1))[: len(self._radii), 0]
        for first in range(0, len(self._radii) - 1, 2):
            left, right = self._radii[first], self._radii[first + 2]
            for x, weight in zip(GAUSS, WEIGHT, strict=True):
                radius = left + (right - left) * (1 + x) / 2
                ring = 2 * np.pi * radius * weight * (right - left) / 2
                load[first : first + 3] -= ring * float(pressure(radius)) * _parabolas(x)[0]
        force = np.zeros(2 * len(self._place))
        force[2 * (np.arange(len(self._radii)) * self._up + self._up - 1) + 1] = load
        moved = np.zeros_like(force)
        free = self._free
        moved[free] = spsolve(self._stiffness[free][:, free], force[free])
        grid = moved.reshape(len(self._radii), self._up, 2)
        found = RegularGridInterpolator((self._radii, self._share), grid)

        def at(radius, depth_mm):
            share = 1 - depth_mm / (self._thickness + self._height(radius))
            return np.moveaxis(found(np.stack([radius, share], -1)), -1, 0)

        return at, -float(load.sum())
