"""Contact between a surface of elements and a rigid indenter: a stiff penalty, with or without friction.

The normal pressure is `stiffness` times the penetration. Friction is Coulomb's: a tangential spring starts where a
point stuck to the indenter, and slips at the friction coefficient times the pressure of the previous increment. This
keeps the equations symmetric and, since increments are small, does not change the result. An infinite coefficient
sticks, zero is smooth. Stresses are over the shear modulus, and per area at rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_nodes.shapes import Bool, Float
from tactile_nodes.simulation.elements import Mesh, shapes
from tactile_nodes.simulation.indenter import Indenter

POINTS, POINT_WEIGHT = np.polynomial.legendre.leggauss(4)
VALUES = shapes(POINTS)[0]


class Where(NamedTuple):
    """Position of the indenter's lowest point: sideways, and down from the surface at rest [mm]."""

    across_mm: float
    depth_mm: float


class Touch(NamedTuple):
    """Forces of the indenter on the surface, edge by edge of the elements."""

    force: Float[np.ndarray, 'edges 6']
    stiffness: Float[np.ndarray, 'edges 6 6']
    pushes: Float[np.ndarray, ' 2']
    touching: Bool[np.ndarray, 'edges 4']
    pressure: Float[np.ndarray, 'edges 4']
    place_mm: Float[np.ndarray, 'edges 4 2']
    energy: float


class Contact:
    """The upper side of a mesh against one indenter. It stores where its points stuck."""

    def __init__(self, mesh: Mesh, indenter: Indenter, friction: float, stiffness: float = 2e4) -> None:
        rows = mesh.nodes[1]
        top = (2 * np.arange(len(mesh.across_mm) - 1)[:, None] + np.arange(3)) * rows + rows - 1
        self.unknowns = (2 * top[:, :, None] + np.arange(2)).reshape(-1, 6)
        half = np.diff(mesh.across_mm)[:, None] / 2
        self.rest_mm = mesh.across_mm[:-1, None] + half * (1 + POINTS)
        self._weight = POINT_WEIGHT * half * (1.0 if mesh.plane else 2 * np.pi * self.rest_mm)
        self._indenter, self._friction = indenter, friction
        # If points may slip, a softer spring lets Newton's method find which ones do.
        self._stiffness, self._hold = stiffness, stiffness / (5 if np.isinf(friction) else 20)
        self._anchor = np.zeros((*self.rest_mm.shape, 2))
        self._tangent = np.zeros_like(self._anchor)
        self._limit = np.zeros(self.rest_mm.shape)

    def touch(self, u: Float[np.ndarray, ' unknowns'], where: Where) -> Touch:
        """Forces and stiffness at displacements `u` and indenter position `where`.

        `pushes` is the force on the gel (across, down) over the shear modulus: the derivative of the energy with
        respect to the indenter's position.
        """
        place = self._place(u)
        gap, normal, curvature = self._indenter.touch(*self._relative(place, where))
        touching = gap < 0
        pressure = np.where(touching, -self._stiffness * gap, 0)
        slide = ((self._from_tip(place, where) - self._anchor) * self._tangent).sum(-1)
        sticks = self._hold * np.abs(slide) <= self._limit
        drag = np.where(sticks, self._hold * slide, np.where(np.isfinite(self._limit), self._limit, 0) * np.sign(slide))
        pull = (drag[..., None] * self._tangent - pressure[..., None] * normal) * self._weight[..., None]
        across = np.stack([-normal[..., 1], normal[..., 0]], -1)
        moduli = (
            self._stiffness
            * touching[..., None, None]
            * (_square(normal) + (gap * curvature)[..., None, None] * _square(across))
        )
        moduli = moduli + self._hold * sticks[..., None, None] * _square(self._tangent)
        stored = pressure**2 / (2 * self._stiffness) + drag**2 / (2 * self._hold)
        return Touch(
            np.einsum('eqc,qa->eac', pull, VALUES).reshape(-1, 6),
            np.einsum('eqcd,qa,qb->eacbd', moduli * self._weight[..., None, None], VALUES, VALUES).reshape(-1, 6, 6),
            pull.sum((0, 1)) * [-1, 1],
            touching,
            pressure,
            place,
            float((stored * self._weight).sum()),
        )

    def hold(self, u: Float[np.ndarray, ' unknowns'], where: Where) -> None:
        """Store the present state as the reference for the friction of the next increment."""
        touched = self.touch(u, where)
        _, normal, _ = self._indenter.touch(*self._relative(touched.place_mm, where))
        at_surface = self._from_tip(touched.place_mm, where)
        slide = ((at_surface - self._anchor) * self._tangent).sum(-1)
        most = np.where(np.isfinite(self._limit), self._limit / self._hold, np.inf)
        kept = np.where(touched.touching & (self._limit > 0), np.clip(slide, -most, most), 0)
        self._tangent = np.stack([-normal[..., 1], normal[..., 0]], -1) * touched.touching[..., None]
        self._anchor = at_surface - kept[..., None] * self._tangent
        if self._friction > 0:
            limit = (
                np.full_like(touched.pressure, np.inf)
                if np.isinf(self._friction)
                else self._friction * touched.pressure
            )
            self._limit = np.where(touched.touching, limit, 0)

    def _place(self, u: np.ndarray) -> Float[np.ndarray, 'edges 4 2']:
        place: np.ndarray = np.einsum('qa,eac->eqc', VALUES, u[self.unknowns].reshape(-1, 3, 2))
        place[..., 0] += self.rest_mm
        return place

    @staticmethod
    def _from_tip(place: np.ndarray, where: Where) -> np.ndarray:
        moved: np.ndarray = place + np.array([-where.across_mm, where.depth_mm])
        return moved

    def _relative(self, place: np.ndarray, where: Where) -> tuple[np.ndarray, np.ndarray]:
        moved = self._from_tip(place, where)
        return moved[..., 0], moved[..., 1]


def _square(vector: np.ndarray) -> Float[np.ndarray, '*points 2 2']:
    squared: np.ndarray = vector[..., :, None] * vector[..., None, :]
    return squared
