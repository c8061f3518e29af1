"""The finite-strain solution of a layer under one indenter at a series of depths, and its lookup table.

The solution is relative (forces over the shear modulus, displacements in mm), so that gels of every modulus share
it. It consists of small arrays that a caller may store; `key` identifies the problem.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.contact import Where
from tactile_nodes.simulation.elements import INCOMPRESSIBLE, Mesh, graded, shapes, with_middles
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import INDENTERS, PAPER_TIP, Indenter, indenter_of
from tactile_nodes.simulation.mechanics import ContactTable, solve
from tactile_nodes.simulation.monotone import monotone_cubic

OnStep = Callable[[int, int], None]
"""Called with the number of a step, from 1 on, and the number of all."""

RECIPE = 1
"""Raised when the code gives another solution of the same problem."""

FIRST_DEPTHS = (0.0, 0.0125, 0.025, 0.05, 0.075, 0.1)  # of the deepest: light touches change fastest

SMALL_MM, DEEPEST_SHARE = 1.0, 0.6
"""Indenters up to this radius are solved 2.5 mm deep, larger ones 1.5 mm, but at most to this share of the layer."""

TIP_SHARE = 0.9
"""The same share for a gel's own tip: a gel of 2 mm is solved 1.8 mm deep."""


@dataclass(frozen=True)
class Problem:
    """All that a solution depends on. Lengths in mm; `finest_mm` is the elements' size under the indenter."""

    layer_mm: float = 6.0
    poisson_ratio: float = 0.5
    indenter: Indenter = PAPER_TIP
    sticking: bool = True
    deepest_mm: float = 2.5
    rungs: int = 20
    finest_mm: float = 0.08
    growth: float = 1.12
    reach_mm: float = 36.0

    @property
    def key(self) -> str:
        """Sixteen hexadecimal digits that change with the problem and with the method of solution."""
        text = json.dumps([RECIPE, asdict(self)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def depths_mm(self) -> Float[np.ndarray, ' rungs']:
        """Depths of the solution: `rungs` equal steps, the first two of them divided more finely."""
        even = np.arange(3, self.rungs + 1) / self.rungs
        first = np.array(FIRST_DEPTHS) * 20 / self.rungs
        return self.deepest_mm * np.concatenate([first, even])

    def mesh(self) -> Mesh:
        """Equal elements under the indenter, growing outwards and down."""
        even = min(1.7 * self.indenter.radius_mm, self.reach_mm / 2)
        across = graded(self.reach_mm, self.finest_mm, self.growth, even)
        return Mesh(across, -graded(self.layer_mm, self.finest_mm, self.growth + 0.03)[::-1])

    @property
    def lame(self) -> float:
        """Lamé's constant over the shear modulus, 2 nu / (1 - 2 nu), kept finite."""
        spare = 1 - 2 * self.poisson_ratio
        return min(2 * self.poisson_ratio / spare, INCOMPRESSIBLE) if spare > 0 else INCOMPRESSIBLE


@dataclass(frozen=True)
class Solution:
    """Displacement of every node at every depth, and the force over the shear modulus (mm²)."""

    across_mm: Float[np.ndarray, ' columns']
    z_mm: Float[np.ndarray, ' rows']
    depth_mm: Float[np.ndarray, ' depths']
    force_mm2: Float[np.ndarray, ' depths']
    contact_mm: Float[np.ndarray, ' depths']
    moved_mm: Float32[np.ndarray, 'depths i j 2']
    key: str

    def to_arrays(self) -> dict[str, np.ndarray]:
        """As plain arrays, for a file."""
        return {each.name: np.asarray(getattr(self, each.name)) for each in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Solution:
        """Back from plain arrays. Raises KeyError: one is missing."""
        values: dict[str, Any] = {each.name: arrays[each.name] for each in fields(cls)}
        return cls(**{**values, 'key': str(arrays['key'])})

    def at(
        self, radius_mm: Float[np.ndarray, ' r'], z_mm: Float[np.ndarray, ' z']
    ) -> Float[np.ndarray, 'depths r z 2']:
        """Displacement of material points on a grid, by the elements' quadratic shape functions."""
        across, up = _values(self.across_mm, radius_mm), _values(self.z_mm, z_mm)
        found: np.ndarray = np.einsum('ri,dijc,zj->drzc', across, self.moved_mm, up, optimize=True)
        return found

    def table(self, shear_modulus_mpa: float, spacing_mm: float = 0.1, steps: int = 40) -> ContactTable:
        """The lookup table with equal steps: monotone cubics between the depths."""
        depth = np.linspace(0.0, self.depth_mm[-1], steps + 1)
        layer = float(-self.z_mm[0])
        radius = np.arange(0.0, 3.5 * layer, spacing_mm)
        z = np.linspace(-layer, 0.0, round(layer / spacing_mm) + 1)
        moved = monotone_cubic(self.depth_mm, self.at(radius, z), depth).astype(np.float32)
        force = shear_modulus_mpa * monotone_cubic(self.depth_mm, self.force_mm2, depth)
        contact = np.interp(depth, self.depth_mm, self.contact_mm)
        return ContactTable(depth, radius, z, force, moved[..., 0].copy(), moved[..., 1].copy(), contact)


def problem_of(gel: Gel, indenter: str = 'tip') -> Problem:
    """The problem to solve for a gel under its own tip or another indenter.

    Raises:
        ConfigurationError: no such indenter.
    """
    sticking = gel.contact == 'sticking'
    if indenter == 'tip':
        tip = Indenter(gel.tip_radius_mm, gel.tip_radius_mm)
        deepest = min(Problem.deepest_mm, TIP_SHARE * gel.layer_mm)
        return Problem(gel.layer_mm, gel.poisson_ratio, tip, sticking, deepest_mm=deepest)
    other = INDENTERS.get(indenter) or indenter_of(indenter)
    if other is None:
        raise ConfigurationError(
            f'there is no indenter {indenter!r}; there are: tip, {", ".join(INDENTERS)}, and by their radius in mm '
            'ball:5 and punch:1.5'
        )
    if other == Indenter(gel.tip_radius_mm, gel.tip_radius_mm):
        return problem_of(gel)
    finest = min(other.radius_mm / 15, other.edge_mm)
    deepest = min(1.5 if other.radius_mm > SMALL_MM else 2.5, DEEPEST_SHARE * gel.layer_mm)
    return Problem(gel.layer_mm, gel.poisson_ratio, other, sticking, deepest_mm=deepest, finest_mm=finest)


def solve_gel(gel: Gel) -> ContactTable:
    """The table of a gel's own tip, solved now with the mechanics that the gel names."""
    if gel.mechanics == 'linear':
        return solve(gel)
    return solve_problem(problem_of(gel)).table(gel.shear_modulus_mpa)


def solve_problem(problem: Problem, on_step: OnStep | None = None) -> Solution:
    """Press to all depths in turn; takes ten to thirty seconds with the defaults.

    `on_step` is called before each depth.
    """
    from tactile_nodes.simulation.finite_strain import Indentation  # SciPy's solvers, for a new gel

    press = Indentation(
        problem.mesh(), problem.indenter, friction=np.inf if problem.sticking else 0.0, lame=problem.lame
    )
    force, contact, moved = [0.0], [0.0], [press.state.u]
    depths = problem.depths_mm[1:].tolist()
    for number, depth in enumerate(depths, 1):
        if on_step is not None:
            on_step(number, len(depths))
        press.advance(Where(0.0, depth), step_mm=0.01 * problem.deepest_mm)
        touch = press.touch
        force.append(float(touch.pushes[1]))
        contact.append(float(touch.place_mm[touch.touching, 0].max(initial=0.0)))
        moved.append(press.state.u)
    mesh = press.body.mesh
    nodes = np.stack(moved).reshape(-1, *mesh.nodes, 2).astype(np.float32)
    return Solution(
        mesh.across_mm, mesh.z_mm, problem.depths_mm, np.array(force), np.array(contact), nodes, problem.key
    )


def _values(lines: Float[np.ndarray, ' n'], places: Float[np.ndarray, ' p']) -> Float[np.ndarray, 'p nodes']:
    """Weight of each node of a line of elements at each place; beyond its ends that of the end."""
    places = np.clip(places, lines[0], lines[-1])
    cell = np.clip(np.searchsorted(lines, places, side='right') - 1, 0, len(lines) - 2)
    local = 2 * (places - lines[cell]) / (lines[cell + 1] - lines[cell]) - 1
    values = np.zeros((len(places), len(with_middles(lines))))
    rows = np.arange(len(places))[:, None]
    values[rows, 2 * cell[:, None] + np.arange(3)] = shapes(local)[0]
    return values
