"""Tables of gels under the tip, each solved once for all tests of a process."""

from __future__ import annotations

import dataclasses
from functools import cache

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve


@cache
def coarse_table() -> ContactTable:
    """Solved in few steps: good enough where the force itself is not under test."""
    return solve(Gel(), steps=4)


def linear_table(gel: Gel) -> ContactTable:
    """That of a linear layer, as the simulator has it; hardness, markers and camera do not change how it moves."""
    table = _solved(gel.layer_mm, gel.poisson_ratio, gel.tip_radius_mm)
    return dataclasses.replace(table, force_n=gel.shear_modulus_mpa * table.force_n)


@cache
def _solved(layer_mm: float, poisson_ratio: float, tip_radius_mm: float) -> ContactTable:
    half_mm = layer_mm / 2
    gel = Gel(soft_mm=half_mm, skin_mm=half_mm, poisson_ratio=poisson_ratio, tip_radius_mm=tip_radius_mm)
    return solve(dataclasses.replace(gel, mechanics='linear', shear_modulus_mpa=1.0))
