"""The digital line of a rig as recorders see it: on a control line, and as a light in a camera's view."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.world import Edge, World
from tactile_nodes.simulation import worlds


class SharedLine:
    """The line of a world that is shared by name in this process, as a control line; low while there is none."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._clock = clock

    def level(self) -> bool:
        world = worlds.find(self._name)
        return isinstance(world, World) and world.line_level(self._clock.now_ns())

    def wait(self) -> bool:
        """Not possible: a simulated line has no interrupt."""
        return False

    def close(self) -> None:
        """Nothing to close."""


def light_brightness(
    edges: Sequence[Edge], start_ns: int, exposure_s: float, dark: float = 20.0, bright: float = 220.0
) -> float:
    """Grey level of a light that follows the line, in a frame whose exposure starts at `start_ns`."""
    end_ns = start_ns + round(exposure_s * NS_PER_S)
    lit_ns, on, since_ns = 0, False, start_ns
    for edge in edges:
        if edge.stamp_ns >= end_ns:
            break
        if edge.stamp_ns > start_ns:
            lit_ns += on * (edge.stamp_ns - since_ns)
            since_ns = edge.stamp_ns
        on = edge.level
    lit_ns += on * (end_ns - since_ns)
    return dark + (bright - dark) * lit_ns / (end_ns - start_ns)
