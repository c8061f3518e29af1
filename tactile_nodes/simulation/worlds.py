"""Worlds of this process by name, so that whoever moves a tip and whoever looks at the gel see the same one; and a
world that another process tells.

The rig node shares the world of its simulated devices; a camera node composed with it (``composed_node camera rig``)
asks for it by name. Who comes first does not matter: until a world is shared, nothing touches the gel.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol, runtime_checkable

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press

_KEPT = 1000


@runtime_checkable
class SharedWorld(Protocol):
    """A gel and all that happens to it, at any time that has come."""

    @property
    def gel(self) -> Gel:
        """What is pressed."""
        ...

    @property
    def tables(self) -> Mapping[str, ContactTable]:
        """What each indenter that may press it does to it; at least one."""
        ...

    def press_at(self, time_ns: int) -> Press:
        """Where the tip is; the depth is negative above the gel, and beside it the tip may be anywhere."""
        ...

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:
        """What shapes the gel: the tip where it touches, and dents that heal."""
        ...

    def force_at(self, time_ns: int) -> float:
        """Force of the tip in N."""
        ...


class ToldWorld:
    """A gel whose touch is told moment by moment: between two moments in between, after the last as then.

    `put` may be called from another thread than the rest.
    """

    def __init__(self, gel: Gel, table: ContactTable) -> None:
        self._gel, self._table = gel, table
        self._told: deque[tuple[int, Press]] = deque([(0, Press(0.0, 0.0, -1.0))], maxlen=_KEPT)

    @property
    def gel(self) -> Gel:
        return self._gel

    @property
    def tables(self) -> Mapping[str, ContactTable]:
        return {'tip': self._table}

    def put(self, time_ns: int, press: Press) -> None:
        """What touches at a time; one that is not after the last is passed over."""
        if time_ns > self._told[-1][0]:
            self._told.append((time_ns, press))

    def press_at(self, time_ns: int) -> Press:
        told = list(self._told)
        after = bisect.bisect_right(told, time_ns, key=lambda each: each[0])
        if after in {0, len(told)}:
            return told[max(0, after - 1)][1]
        (early_ns, early), (late_ns, late) = told[after - 1], told[after]
        share = (time_ns - early_ns) / (late_ns - early_ns)

        def between(low: float, high: float) -> float:
            return low + share * (high - low)

        return replace(
            late, x_mm=between(early.x_mm, late.x_mm), y_mm=between(early.y_mm, late.y_mm),
            depth_mm=between(early.depth_mm, late.depth_mm),
            shift_mm=(between(early.shift_mm[0], late.shift_mm[0]), between(early.shift_mm[1], late.shift_mm[1])),
        )  # fmt: skip

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:
        return (self.press_at(time_ns),)

    def force_at(self, time_ns: int) -> float:
        return self._table.force_at(self.press_at(time_ns).depth_mm)


_worlds: dict[str, SharedWorld] = {}


def share(name: str, world: SharedWorld) -> None:
    """Let others of this process find a world; a later one of that name takes its place."""
    _worlds[name] = world


def find(name: str) -> SharedWorld | None:
    """The world that has this name now."""
    return _worlds.get(name)
