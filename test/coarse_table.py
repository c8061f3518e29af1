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
    table = _solved(dataclasses.replace(gel, shear_modulus_mpa=1.0, seed=0, camera_shift_mm=(0.0, 0.0)))
    return dataclasses.replace(table, force_n=gel.shear_modulus_mpa * table.force_n)


_solved = cache(solve)
