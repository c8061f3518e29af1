"""The state of a settling gel under a schedule, as a function of time alone.

The past is replayed from some settling times before, on a time grid that does not depend on the calls. So the same
time gives the same answer in every process and in any order.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.settling import NO_DENT_MM, NS_PER_S, Settled, Settling

STEP_NS = 5_000_000
STEPS_PER_BLOCK = 200  # a starting state is used for one second
BLOCKS_KEPT = 3
TIMES_REMEMBERED = 8  # settling times; earlier touches have decayed to one part in 3000
SAME_PLACE_MM = 0.01

Place = tuple[float, float, str]


class Shape(NamedTuple):
    """The presses that shape the gel, and the force of the tip."""

    presses: tuple[Press, ...]
    force_n: float


class Memory:
    """The state of a settling gel under a schedule, at any time; the near past costs no more than the present."""

    def __init__(self, gel: Gel, press_at: Callable[[int], Press], tables: Mapping[str, ContactTable]) -> None:
        self._gel, self._press_at, self._tables = gel, press_at, tables
        lasting_s = TIMES_REMEMBERED * (1 + gel.settling_share) * gel.settling_s
        self._steps_remembered = math.ceil(lasting_s * NS_PER_S / STEP_NS)
        self._blocks: dict[int, list[_Track]] = {}

    def at(self, time_ns: int) -> Shape:
        block, step = divmod(time_ns // STEP_NS, STEPS_PER_BLOCK)
        tracks = self._blocks.get(block) or self._begin(block)
        for later in range(len(tracks), step + 1):
            tracks.append(tracks[-1].copy())
            self._feed(tracks[-1], block * STEPS_PER_BLOCK + later)
        return tracks[step].copy().feed(time_ns, self._press_at(time_ns))

    def _begin(self, block: int) -> list[_Track]:
        """The state at the start of a block, computed by replaying the past."""
        track, first = _Track(self._gel, self._tables), block * STEPS_PER_BLOCK
        for step in range(first - self._steps_remembered, first + 1):
            self._feed(track, step)
        while len(self._blocks) >= BLOCKS_KEPT:
            del self._blocks[next(iter(self._blocks))]
        self._blocks[block] = [track]
        return self._blocks[block]

    def _feed(self, track: _Track, step: int) -> None:
        track.feed(step * STEP_NS, self._press_at(step * STEP_NS))


class _Track:
    """Recently pressed places, each settling independently."""

    def __init__(self, gel: Gel, tables: Mapping[str, ContactTable]) -> None:
        self._gel, self._tables = gel, tables
        self._places: dict[Place, Settling] = {}

    def copy(self) -> _Track:
        other = _Track(self._gel, self._tables)
        other._places = {place: gel.copy() for place, gel in self._places.items()}
        return other

    def feed(self, time_ns: int, press: Press) -> Shape:
        if not self._places and press.depth_mm <= 0:
            return Shape((press,), 0.0)
        touched = self._place_of(press)
        if touched not in self._places and press.depth_mm > 0:
            share, settling_s = self._gel.settling_share, self._gel.settling_s
            self._places[touched] = Settling(self._tables[press.indenter], share, settling_s, time_ns)
        dents = {
            place: gel.advance(time_ns, press.depth_mm if place == touched else -1.0)
            for place, gel in self._places.items()
        }
        self._places = {place: gel for place, gel in self._places.items() if dents[place].depth_mm > NO_DENT_MM}
        return Shape(_presses(press, touched, dents), dents[touched].force_n if touched in dents else 0.0)

    def _place_of(self, press: Press) -> Place:
        """The place of a press; rounding by the machine does not make a new place."""
        x_mm, y_mm, tip = touched = press.x_mm, press.y_mm, press.indenter
        if touched in self._places:
            return touched
        near = (
            place
            for place in self._places
            if place[2] == tip and abs(place[0] - x_mm) < SAME_PLACE_MM and abs(place[1] - y_mm) < SAME_PLACE_MM
        )
        return next(near, touched)


def _presses(press: Press, touched: Place, dents: Mapping[Place, Settled]) -> tuple[Press, ...]:
    own = dataclasses.replace(press, depth_mm=dents[touched].depth_mm) if touched in dents else press
    others = (Press(x, y, dent.depth_mm, tip) for (x, y, tip), dent in dents.items() if (x, y, tip) != touched)
    return (own, *(each for each in others if each.depth_mm > NO_DENT_MM))
