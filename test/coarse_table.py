"""Tables of gels under the tip, each solved once for all tests of a process."""

from __future__ import annotations

from functools import cache

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve


@cache
def coarse_table() -> ContactTable:
    """Solved in few steps: good enough where the force itself is not under test."""
    return solve(Gel(), steps=4)


@cache
def linear_table(gel: Gel) -> ContactTable:
    """That of a linear layer, as the simulator has it."""
    return solve(gel)
