"""Mounting of a force/torque sensor on the machine: the rotation between their axes."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.emulators.world import Wrench, WrenchSource

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

UPRIGHT: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
UPSIDE_DOWN: Matrix = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
"""Half a turn about x: for a sensor that hangs from the machine, with z pointing to the tool."""


@dataclass(frozen=True)
class Mounted:
    """A sensor with a rotation: the wrench that it measures in a world, and its reading without load.

    Attributes:
        world: in the machine's axes.
        sensor_from_machine: the rotation; both the force and the torque are turned by it. With `UPSIDE_DOWN`,
            a force of (1, 2, 3) N reads (1, -2, -3) N.
        unloaded: its reading without load: zero offset of its bridge, and weight of the tool, in its own axes.
    """

    world: WrenchSource
    sensor_from_machine: Matrix = UPRIGHT
    unloaded: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def wrench_at(self, time_ns: int) -> Wrench:
        """The wrench in the sensor's axes, in N and N·m."""
        wrench = self.world.wrench_at(time_ns)
        if not any(wrench):  # the usual case, which is faster this way
            return self.unloaded
        fx, fy, fz, tx, ty, tz = wrench
        force, torque = self._turned(fx, fy, fz), self._turned(tx, ty, tz)
        zero = self.unloaded
        return (
            force[0] + zero[0], force[1] + zero[1], force[2] + zero[2],
            torque[0] + zero[3], torque[1] + zero[4], torque[2] + zero[5],
        )  # fmt: skip

    def _turned(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        a, b, c = self.sensor_from_machine
        return (
            a[0] * x + a[1] * y + a[2] * z,
            b[0] * x + b[1] * y + b[2] * z,
            c[0] * x + c[1] * y + c[2] * z,
        )
