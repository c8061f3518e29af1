"""Worlds of this process by name, so that whoever moves a tip and whoever looks at the gel see the same one.

The rig node shares the world of its simulated devices; a camera node composed with it (``composed_node camera rig``)
asks for it by name. Who comes first does not matter: until a world is shared, nothing touches the gel.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.scene import Schedule

UNTOUCHED = Press(0.0, 0.0, -1.0)
_worlds: dict[str, Schedule] = {}


def share(name: str, world: Schedule) -> None:
    """Let others of this process find a world; a later one of that name takes its place."""
    _worlds[name] = world


@dataclass(frozen=True)
class Shared:
    """The world that has this name when it is looked at."""

    name: str

    def press_at(self, time_ns: int) -> Press:
        """As of that world; while the tip is above or beside the gel, over its middle."""
        world = _worlds.get(self.name)
        press = UNTOUCHED if world is None else world.press_at(time_ns)
        return press if press.depth_mm > 0 else Press(0.0, 0.0, min(press.depth_mm, 0.0))
