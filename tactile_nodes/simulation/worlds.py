"""Simulated worlds of this process by name, so that the code that moves a tip and the camera share one world; and a
world that another process drives.

The rig node shares the world of its simulated devices; a camera node composed with it (``composed_node camera rig``)
gets it by name, in either order: until a world is shared, nothing touches the gel.
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
    """A gel and all that touches it, at any time up to now."""

    @property
    def gel(self) -> Gel: ...

    @property
    def tables(self) -> Mapping[str, ContactTable]:
        """Contact tables of the indenters that may press it; at least one."""
        ...

    def press_at(self, time_ns: int) -> Press:
        """Position of the tip; its depth is negative above the gel, and it may also be beside the gel."""
        ...

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:
        """What deforms the gel: the tip during contact, and dents that heal."""
        ...

    def force_at(self, time_ns: int) -> float:
        """Force of the tip [N]."""
        ...


class InterpolatedWorld:
    """A gel whose touch is given at single moments: interpolated between them, and held after the last one.

    `put` may be called from another thread than the other methods.
    """

    def __init__(self, gel: Gel, table: ContactTable) -> None:
        self._gel, self._table = gel, table
        self._moments: deque[tuple[int, Press]] = deque([(0, Press(0.0, 0.0, -1.0))], maxlen=_KEPT)

    @property
    def gel(self) -> Gel:
        return self._gel

    @property
    def tables(self) -> Mapping[str, ContactTable]:
        return {'tip': self._table}

    def put(self, time_ns: int, press: Press) -> None:
        """Set what touches at a time; it is ignored unless the time is after the last one."""
        if time_ns > self._moments[-1][0]:
            self._moments.append((time_ns, press))

    def press_at(self, time_ns: int) -> Press:
        moments = list(self._moments)
        after = bisect.bisect_right(moments, time_ns, key=lambda each: each[0])
        if after in {0, len(moments)}:
            return moments[max(0, after - 1)][1]
        (early_ns, early), (late_ns, late) = moments[after - 1], moments[after]
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
    """Share a world within this process; a later one of the same name replaces it."""
    _worlds[name] = world


def find(name: str) -> SharedWorld | None:
    """The world of this name, if one is shared."""
    return _worlds.get(name)
