"""The table of a gel, solved in few steps."""

from __future__ import annotations

from functools import cache

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve


@cache
def coarse_table() -> ContactTable:
    """Good enough where the force itself is not under test."""
    return solve(Gel(), steps=4)
