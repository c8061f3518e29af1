"""A viscoelastic gel that settles under a tip and recovers after it: a standard linear solid.

The settled force at a depth is that of the contact table. One Maxwell element acts in parallel: the force is
F + share (F - q), with F the settled force at the present depth and q following F with the time constant
`settling_s`. So a sudden press takes 1 + share times the settled force, and settles as exp(-t / settling_s) while it
is held. By the correspondence principle the displacements of a homogeneous gel under a tip at a given depth do not
settle. A tip that leaves faster than the gel recovers leaves a dent: the depth at which the gel alone is in
equilibrium, F = share q / (1 + share), which heals as exp(-t / (settling_s (1 + share))).
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

from tactile_nodes.simulation.mechanics import ContactTable

NS_PER_S = 1_000_000_000
NO_DENT_MM = 1e-3


@dataclass(frozen=True)
class Settled:
    """The dent in the gel (the tip's depth during contact) and the force on the tip (0 without contact)."""

    depth_mm: float
    force_n: float


class Settling:
    """The gel at one place of contact; feed it with times and depths in order of time."""

    def __init__(self, table: ContactTable, share: float, settling_s: float, time_ns: int) -> None:
        self._table = table
        self._share, self._settling_s = share, settling_s
        self._time_ns = time_ns
        self._follows_n = self._settled_n = 0.0

    def copy(self) -> Settling:
        return copy.copy(self)

    def advance(self, time_ns: int, depth_mm: float) -> Settled:
        """The gel at a time with the tip at a depth; the depth changed linearly since the previous time."""
        settled_n, dent = self._present(depth_mm, self._follows_n)
        self._follows_n = self._follow(time_ns, settled_n)
        self._settled_n, self._time_ns = settled_n, time_ns
        if dent is not None:
            return Settled(dent, 0.0)
        return Settled(depth_mm, max(settled_n + self._share * (settled_n - self._follows_n), 0.0))

    def _present(self, depth_mm: float, follows_n: float) -> tuple[float, float | None]:
        """The settled force at the present shape, and the dent if the tip does not touch."""
        settled_n = self._table.force_at(depth_mm)
        free_n = self._share * follows_n / (1 + self._share)
        if settled_n >= free_n:
            return settled_n, None
        return free_n, self._table.depth_at(free_n)

    def _follow(self, time_ns: int, settled_n: float) -> float:
        """The state of the Maxwell element, exact for a force that changed linearly."""
        passed = (time_ns - self._time_ns) / NS_PER_S / self._settling_s
        if passed <= 0:
            return self._follows_n
        slope = (settled_n - self._settled_n) / passed
        lag = self._follows_n - self._settled_n + slope
        return settled_n - slope + lag * math.exp(-passed)
