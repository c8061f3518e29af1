"""A block of incompressible rubber in finite elements: quadrilaterals with nine nodes and a linear pressure each.

The material is neo-Hookean. Per volume at rest its energy over the shear modulus is

    W = (I1 - 3) / 2 - ln J + p (J - 1) - p² / (2 lambda)

with the pressure-like p as a separate field, linear and discontinuous between elements (Q2/P1, which does not
lock). `lambda` is Lamé's constant over the shear modulus. The code uses the deformation gradient's five entries
(rr, rz, zr, zz, and the hoop), so that axial symmetry and plane strain differ in two lines only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_nodes.shapes import Float, Int

GAUSS, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(3)
HOOP = 4
INCOMPRESSIBLE = 1e5
"""Lamé's constant over the shear modulus for a Poisson's ratio of 0.5: the volume changes by 1e-4 at 10 G."""


@dataclass(frozen=True)
class Mesh:
    """A rectangle divided by lines across (r or x) and by lines up (z, from the base to the surface at 0)."""

    across_mm: Float[np.ndarray, ' columns']
    z_mm: Float[np.ndarray, ' rows']
    plane: bool = False

    @property
    def nodes(self) -> tuple[int, int]:
        """Nodes across and up: two per cell and one more. A node's index is i * up + j, that of its first unknown twice
        that."""
        return 2 * len(self.across_mm) - 1, 2 * len(self.z_mm) - 1

    @property
    def unknowns(self) -> int:
        return 2 * self.nodes[0] * self.nodes[1]


def with_middles(lines: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' m']:
    """The lines and the midpoints between them, in order."""
    places = np.empty(2 * len(lines) - 1)
    places[::2], places[1::2] = lines, (lines[1:] + lines[:-1]) / 2
    return places


def graded(length_mm: float, first_mm: float, growth: float, even_mm: float = 0.0) -> Float[np.ndarray, ' n']:
    """Lines from 0 to `length_mm`: steps of `first_mm` up to `even_mm`, then each larger by the factor `growth`."""
    steps = [first_mm] * round(even_mm / first_mm)
    tail = [first_mm * growth]
    while sum(steps) + sum(tail) < length_mm:
        tail.append(tail[-1] * growth)
    stretch = (length_mm - sum(steps)) / sum(tail)
    return np.concatenate([[0.0], np.cumsum(steps + [step * stretch for step in tail])])


def shapes(x: Float[np.ndarray, ' n']) -> tuple[Float[np.ndarray, 'n 3'], Float[np.ndarray, 'n 3']]:
    """The three quadratic shape functions of a line element and their derivatives, at places from -1 to 1."""
    return np.stack([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2], -1), np.stack([x - 0.5, -2 * x, x + 0.5], -1)


class Linearised(NamedTuple):
    """Forces and stiffness of a body, linearised about a state, element by element."""

    volume: Float[np.ndarray, 'elements 9']
    force: Float[np.ndarray, 'elements 18']
    dilation: Float[np.ndarray, 'elements 3']
    stiffness: Float[np.ndarray, 'elements 18 18']
    coupling: Float[np.ndarray, 'elements 18 3']


class Body:
    """The elements of a mesh; lengths in mm, stresses over the shear modulus."""

    def __init__(self, mesh: Mesh, lame: float = INCOMPRESSIBLE) -> None:
        self.mesh, self._lame = mesh, lame
        columns, rows = len(mesh.across_mm) - 1, len(mesh.z_mm) - 1
        i, j = (each.ravel() for each in np.meshgrid(np.arange(columns), np.arange(rows), indexing='ij'))
        self.unknowns = _unknowns(i, j, mesh.nodes[1])
        half_r, half_z = np.diff(mesh.across_mm)[i] / 2, np.diff(mesh.z_mm)[j] / 2
        place = mesh.across_mm[i, None] + half_r[:, None] * (1 + np.repeat(GAUSS, 3))
        self.gradient = _gradient(half_r, half_z, None if mesh.plane else place)
        self.weight = np.outer(GAUSS_WEIGHT, GAUSS_WEIGHT).ravel() * (half_r * half_z)[:, None]
        if not mesh.plane:
            self.weight = self.weight * 2 * np.pi * place
        self.modes = np.stack([np.ones(9), np.repeat(GAUSS, 3), np.tile(GAUSS, 3)], -1)
        softness = np.einsum('eq,qa,qb->eab', self.weight, self.modes, self.modes)
        self.stiff_pressure = -lame * np.linalg.inv(softness)

    def deformation(self, u: Float[np.ndarray, ' unknowns']) -> Float[np.ndarray, 'elements 9 5']:
        """The deformation gradient rr, rz, zr, zz and hoop at the integration points."""
        deformed: np.ndarray = np.einsum('eqka,ea->eqk', self.gradient, u[self.unknowns])
        deformed[..., [0, 3, HOOP]] += 1
        return deformed

    def volume(self, u: Float[np.ndarray, ' unknowns']) -> Float[np.ndarray, 'elements 9']:
        """Volume over volume at rest, det F."""
        f = self.deformation(u)
        ratio: np.ndarray = f[..., HOOP] * (f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2])
        return ratio

    def energy(self, u: Float[np.ndarray, ' unknowns'], p: Float[np.ndarray, 'elements 3']) -> float:
        """Elastic energy over the shear modulus, in mm³ (mm² in plane strain)."""
        f, volume, pressure = self.deformation(u), self.volume(u), p @ self.modes.T
        density = ((f * f).sum(-1) - 3) / 2 - np.log(volume) + pressure * (volume - 1) - pressure**2 / (2 * self._lame)
        return float((self.weight * density).sum())

    def linearise(self, u: Float[np.ndarray, ' unknowns'], p: Float[np.ndarray, 'elements 3']) -> Linearised:
        """Forces and stiffness of every element at displacements `u` and pressures `p`."""
        f, pressure = self.deformation(u), p @ self.modes.T
        volume = self.volume(u)
        cofactor = _cofactor(f)
        stress = f + (pressure - 1 / volume)[..., None] * cofactor
        moduli = (pressure - 1 / volume)[..., None, None] * _cofactor_slope(f)
        moduli += cofactor[..., :, None] * cofactor[..., None, :] / volume[..., None, None] ** 2
        moduli[..., range(5), range(5)] += 1
        moduli *= self.weight[..., None, None]
        count = len(f)
        across = self.gradient.reshape(count, 45, 18).transpose(0, 2, 1)
        weighted = (self.weight[..., None] * cofactor)[..., None] * self.modes[:, None, :]
        return Linearised(
            volume,
            np.einsum('eqka,eqk->ea', self.gradient, self.weight[..., None] * stress),
            np.einsum('eq,qa->ea', self.weight * (volume - 1 - pressure / self._lame), self.modes),
            across @ (moduli @ self.gradient).reshape(count, 45, 18),
            across @ weighted.reshape(count, 45, 3),
        )


def _unknowns(i: np.ndarray, j: np.ndarray, rows: int) -> Int[np.ndarray, 'elements 18']:
    three = np.arange(3)
    nodes = ((2 * i[:, None, None] + three[:, None]) * rows + 2 * j[:, None, None] + three).reshape(-1, 9)
    both: np.ndarray = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 18)
    return both


def _gradient(
    half_r: np.ndarray, half_z: np.ndarray, radius: np.ndarray | None
) -> Float[np.ndarray, 'elements 9 5 18']:
    value, slope = shapes(GAUSS)
    inside, along_r, along_z = (
        np.einsum('qa,pb->qpab', one, two).reshape(9, 9)
        for one, two in ((value, value), (slope, value), (value, slope))
    )
    gradient = np.zeros((len(half_r), 9, 5, 18))
    for component in (0, 1):
        gradient[:, :, 2 * component, component::2] = along_r / half_r[:, None, None]
        gradient[:, :, 2 * component + 1, component::2] = along_z / half_z[:, None, None]
    if radius is not None:
        gradient[:, :, HOOP, 0::2] = inside / radius[:, :, None]
    return gradient


def _cofactor(f: np.ndarray) -> Float[np.ndarray, '*points 5']:
    """d det F / dF."""
    rr, rz, zr, zz, hoop = np.moveaxis(f, -1, 0)
    return np.stack([hoop * zz, -hoop * zr, -hoop * rz, hoop * rr, rr * zz - rz * zr], -1)


def _cofactor_slope(f: np.ndarray) -> Float[np.ndarray, '*points 5 5']:
    """d² det F / dF dF."""
    rr, rz, zr, zz, hoop = np.moveaxis(f, -1, 0)
    slope = np.zeros((*f.shape, 5))
    for one, two, value in ((0, 3, hoop), (1, 2, -hoop), (0, 4, zz), (3, 4, rr), (1, 4, -zr), (2, 4, -rz)):
        slope[..., one, two] = slope[..., two, one] = value
    return slope
