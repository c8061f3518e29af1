"""What a settling gel remembers of a schedule, as a function of time alone.

The past is replayed from a beginning some settling times before, on a grid of instants that does not depend on who
asks when; so the same time gives the same answer in every process and in any order.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.settling import NO_DENT_MM, NS_PER_S, Settled, Settling

STEP_NS = 5_000_000
STEPS_PER_BLOCK = 200  # a beginning serves for one second
TIMES_REMEMBERED = 8  # settling times; what was before is forgotten to one part in 3000


class Shape(NamedTuple):
    """What shapes the gel, and the force of the tip."""

    presses: tuple[Press, ...]
    force_n: float


class Memory:
    """The state of a settling gel under a schedule, at any time."""

    def __init__(self, gel: Gel, press_at: Callable[[int], Press], tables: Mapping[str, ContactTable]) -> None:
        self._gel, self._press_at, self._tables = gel, press_at, tables
        self._first = self._last = 0
        self._track = _Track(gel, tables)

    def at(self, time_ns: int) -> Shape:
        """The gel at a time."""
        last = time_ns // STEP_NS
        lasting_ns = TIMES_REMEMBERED * (1 + self._gel.settling_share) * self._gel.settling_s * NS_PER_S
        first = last // STEPS_PER_BLOCK * STEPS_PER_BLOCK - int(lasting_ns / STEP_NS)
        if first != self._first or last < self._last:
            self._track, self._first, self._last = _Track(self._gel, self._tables), first, first
        for step in range(self._last, last + 1):
            self._track.feed(step * STEP_NS, self._press_at(step * STEP_NS))
        self._last = last + 1
        return self._track.copy().feed(time_ns, self._press_at(time_ns))


class _Track:
    """The places that were pressed lately, each settling for itself."""

    def __init__(self, gel: Gel, tables: Mapping[str, ContactTable]) -> None:
        self._gel, self._tables = gel, tables
        self._places: dict[tuple[float, float, str], Settling] = {}

    def copy(self) -> _Track:
        other = _Track(self._gel, self._tables)
        other._places = {place: gel.copy() for place, gel in self._places.items()}
        return other

    def feed(self, time_ns: int, press: Press) -> Shape:
        here = press.x_mm, press.y_mm, press.indenter
        if here not in self._places and press.depth_mm > 0:
            share, settling_s = self._gel.settling_share, self._gel.settling_s
            self._places[here] = Settling(self._tables[press.indenter], share, settling_s, time_ns)
        dents = {
            place: gel.advance(time_ns, press.depth_mm if place == here else -1.0)
            for place, gel in self._places.items()
        }
        self._places = {place: gel for place, gel in self._places.items() if dents[place].depth_mm > NO_DENT_MM}
        return Shape(_presses(press, here, dents), dents[here].force_n if here in dents else 0.0)


def _presses(
    press: Press, here: tuple[float, float, str], dents: Mapping[tuple[float, float, str], Settled]
) -> tuple[Press, ...]:
    own = dataclasses.replace(press, depth_mm=dents[here].depth_mm) if here in dents else press
    others = (Press(x, y, dent.depth_mm, tip) for (x, y, tip), dent in dents.items() if (x, y, tip) != here)
    return (own, *(each for each in others if each.depth_mm > NO_DENT_MM))
