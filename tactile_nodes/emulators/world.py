"""The one scene that every emulated device shares: where the tip is, what it feels, and the digital line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

Wrench = tuple[float, float, float, float, float, float]


class Edge(NamedTuple):
    """A change of the digital line: when, and the level from then on."""

    stamp_ns: int
    level: bool


class WrenchSource(Protocol):
    """What a force/torque sensor feels."""

    def wrench_at(self, time_ns: int) -> Wrench:
        """(Fx, Fy, Fz, Tx, Ty, Tz) in N and N·m at a time on the clock's base, past or present.

        It is what the world does TO the sensor's tool side, in axes parallel to the machine's (z up, out of the
        gel), torques about the sensor's origin: pressing the gel straight down gives Fz > 0, hanging free gives
        zero. How a real sensor is mounted (an ATI whose z points to the tool reads the negative) is for the
        emulated sensor to say.
        """
        ...


class LineSource(Protocol):
    """The digital line that the CNC switches (its coolant output, M8 and M9) and recorders watch."""

    def line_level(self, time_ns: int) -> bool:
        """Whether the line was high at a time; low before the first edge."""
        ...

    def line_edges(self) -> Sequence[Edge]:
        """Every change so far, in order of time; the first is a rise."""
        ...
