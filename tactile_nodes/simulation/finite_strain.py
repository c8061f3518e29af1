"""An indenter pressed step by step into a bonded layer of rubber, at finite strain.

Each increment is solved by Newton's method, with the pressures eliminated element by element. An increment that does
not converge is divided. Moduli are relative: the shear modulus is 1, and displacements do not depend on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Bool, Float
from tactile_nodes.simulation.contact import Contact, Touch, Where
from tactile_nodes.simulation.elements import INCOMPRESSIBLE, Body, Mesh
from tactile_nodes.simulation.indenter import Indenter

TOLERANCE = 1e-6  # of the residual forces over G, where a press takes 0.02 to 12 mm²
MOST_ITERATIONS = 15
LONGEST_STEP_MM = 0.1  # of any node in one iteration
LEAST_VOLUME = 0.05  # no iteration may flatten an element further


@dataclass(frozen=True)
class State:
    """Displacements and pressures in equilibrium with an indenter at a position."""

    where: Where
    u: Float[np.ndarray, ' unknowns']
    p: Float[np.ndarray, 'elements 3']


class Indentation:
    """A layer and an indenter, from the first touch on. `advance` moves the indenter; `state` is the present state."""

    def __init__(
        self,
        mesh: Mesh,
        indenter: Indenter,
        *,
        friction: float = np.inf,
        lame: float = INCOMPRESSIBLE,
        symmetric: bool = True,
        start: Where | None = None,
    ) -> None:
        self.body = Body(mesh, lame)
        self.contact = Contact(mesh, indenter, friction)
        self._free = _free(mesh, symmetric)
        self._pattern()
        self.state = State(start or Where(0.0, 0.0), np.zeros(mesh.unknowns), np.zeros((len(self.body.unknowns), 3)))
        self._before = self.state

    def advance(self, where: Where, step_mm: float = 0.025) -> None:
        """Move the indenter in a straight line, in increments of `step_mm` or less.

        Raises:
            ConfigurationError: no equilibrium was found because the strain is too large.
        """
        step = step_mm
        while (way := np.subtract(where, self.state.where)).any():
            part = min(1.0, step / float(np.hypot(*way)))
            target = where if part == 1 else Where(*(np.asarray(self.state.where) + part * way).tolist())
            if self._increment(target):
                step = min(step * 1.5, step_mm)
            elif step > step_mm / 100:
                step /= 2
            else:
                raise ConfigurationError(
                    f'no equilibrium was found beyond a depth of {self.state.where.depth_mm:.2f} mm; '
                    'let the contact stick, press less deep, or use a rounder indenter'
                )

    @property
    def touch(self) -> Touch:
        """The present forces of the indenter on the surface."""
        return self.contact.touch(self.state.u, self.state.where)

    @property
    def energy(self) -> float:
        """Energy stored in layer and contact, over the shear modulus."""
        return self.body.energy(self.state.u, self.state.p) + self.touch.energy

    def _increment(self, target: Where) -> bool:
        found = self._newton(*self._guess(target), target) or self._newton(self.state.u, self.state.p, target)
        if found is None:
            return False
        self._before, self.state = self.state, found
        self.contact.hold(found.u, found.where)
        return True

    def _guess(self, target: Where) -> tuple[np.ndarray, np.ndarray]:
        """Extrapolation of the last increment, unless that inverts an element."""
        now, before = self.state, self._before
        last = np.subtract(now.where, before.where)
        if not last.any():
            return now.u, now.p
        ratio = float(np.subtract(target, now.where) @ last / (last @ last))
        u = now.u + ratio * (now.u - before.u)
        if self.body.volume(u).min() < LEAST_VOLUME:
            return now.u, now.p
        return u, now.p + ratio * (now.p - before.p)

    def _newton(self, u: np.ndarray, p: np.ndarray, where: Where) -> State | None:
        for _ in range(MOST_ITERATIONS):
            body, touch = self.body.linearise(u, p), self.contact.touch(u, where)
            condensed = body.coupling @ self.body.stiff_pressure
            force = body.force - np.einsum('eab,eb->ea', condensed, body.dilation)
            residual = self._gather(force, self.body.unknowns) + self._gather(touch.force, self.contact.unknowns)
            size = np.linalg.norm(residual[self._free])
            if size < TOLERANCE:
                return State(where, u, p)
            if not np.isfinite(size):
                return None
            stiffness = body.stiffness - condensed @ body.coupling.transpose(0, 2, 1)
            du = np.zeros_like(u)
            du[self._free] = -self._solve(stiffness, touch.stiffness, residual[self._free])
            pushed = body.dilation + np.einsum('eab,ea->eb', body.coupling, du[self.body.unknowns])
            dp = -np.einsum('eab,eb->ea', self.body.stiff_pressure, pushed)
            part = self._length(u, du)
            u, p = u + part * du, p + part * dp
        return None

    def _length(self, u: np.ndarray, du: np.ndarray) -> float:
        part = float(min(1.0, LONGEST_STEP_MM / np.abs(du).max()))
        while part > 1e-3 and self.body.volume(u + part * du).min() < LEAST_VOLUME / 2:
            part /= 2
        return part

    def _gather(self, values: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        return np.bincount(unknowns.ravel(), values.ravel(), self.body.mesh.unknowns)

    def _pattern(self) -> None:
        """Position of each entry of each element's stiffness in the matrix of the free unknowns."""
        number = np.full(self.body.mesh.unknowns, -1)
        number[self._free] = np.arange(len(self._free))
        parts = [number[self.body.unknowns], number[self.contact.unknowns]]
        row = np.concatenate([np.repeat(each, each.shape[1], axis=1).ravel() for each in parts])
        column = np.concatenate([np.tile(each, (1, each.shape[1])).ravel() for each in parts])
        self._kept = (row >= 0) & (column >= 0)
        self._row, self._column = row[self._kept], column[self._kept]

    def _solve(self, body: np.ndarray, touch: np.ndarray, right: np.ndarray) -> Float[np.ndarray, ' free']:
        values = np.concatenate([body.ravel(), touch.ravel()])[self._kept]
        size = len(self._free)
        matrix = coo_matrix((values, (self._row, self._column)), (size, size)).tocsc()
        factors = splu(matrix, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=1e-3, options={'SymmetricMode': True})
        solved: np.ndarray = factors.solve(right)
        return solved


def _free(mesh: Mesh, symmetric: bool) -> np.ndarray:
    """Unknowns that may move: the base and the far side are bonded, and so is the near side unless it is an axis."""
    bonded: Bool[np.ndarray, 'i j 2'] = np.zeros((*mesh.nodes, 2), bool)
    bonded[:, 0] = bonded[-1] = True
    bonded[0, :, 0] = True
    bonded[0] |= not symmetric
    return np.flatnonzero(~bonded)
