"""Worlds of this process by name, so that whoever moves a tip and whoever looks at the gel see the same one.

The rig node shares the world of its simulated devices; a camera node composed with it (``composed_node camera rig``)
asks for it by name. Who comes first does not matter: until a world is shared, nothing touches the gel.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Press


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


_worlds: dict[str, SharedWorld] = {}


def share(name: str, world: SharedWorld) -> None:
    """Let others of this process find a world; a later one of that name takes its place."""
    _worlds[name] = world


def find(name: str) -> SharedWorld | None:
    """The world that has this name now."""
    return _worlds.get(name)
