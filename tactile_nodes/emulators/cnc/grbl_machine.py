"""The machine as Grbl represents it: settings, coordinates, planner."""

from __future__ import annotations

from tactile_nodes.emulators.cnc.grbl_code import Command
from tactile_nodes.emulators.cnc.grbl_dialect import DIALECTS, GrblSettings, axes_of
from tactile_nodes.emulators.cnc.planner import Block, Planner
from tactile_nodes.emulators.motion import Vector, plus
from tactile_nodes.emulators.world import World


class GrblMachine:
    """The state of one machine in its controller. `origin` is machine zero in the world's coordinates."""

    def __init__(self, world: World, settings: GrblSettings, now_ns: int) -> None:
        self.world = world
        self.dialect = DIALECTS[settings.dialect]
        self.memory = settings.memory()
        self.planner = Planner(world, self.dialect.planner_blocks)
        self.origin = world.motor_at(now_ns)

    def flag(self, number: int) -> bool:
        return float(self.memory[number]) != 0

    @property
    def inches(self) -> bool:
        return self.flag(13)

    def place(self, now_ns: int) -> Vector:
        return plus(self.world.motor_at(now_ns), self.origin, -1.0)

    def target(self, command: Command, now_ns: int) -> Vector:
        """The target of a motion command in machine coordinates."""
        found = list(plus(self.planner.target(now_ns), self.origin, -1.0))
        for axis, value in command.axes.items():
            found[axis] = value + (found[axis] if command.is_relative else 0.0)
        return (found[0], found[1], found[2])

    def block(self, target: Vector, feed_mm_min: float) -> Block:
        """A straight line to machine coordinates."""
        rates = axes_of(self.memory, 110)
        rates_mm_s = (rates[0] / 60, rates[1] / 60, rates[2] / 60)
        return Block(plus(target, self.origin), feed_mm_min / 60, rates_mm_s, axes_of(self.memory, 120))

    def beyond_travel(self, target: Vector) -> bool:
        """Whether soft limits forbid a target: every axis goes from minus its travel to 0."""
        if not self.flag(20):
            return False
        travel = axes_of(self.memory, 130)
        return any(not -most <= value <= 0.0 for value, most in zip(target, travel, strict=True))
