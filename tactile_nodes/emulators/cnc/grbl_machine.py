"""The machine as Grbl represents it: settings, coordinates, modal state, planner."""

from __future__ import annotations

from tactile_nodes.emulators.cnc.grbl_code import Command, GrblError, Modal
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
        self.writes = 0
        self.reset()

    def reset(self) -> None:
        """Set everything that a soft reset clears."""
        self.modal = Modal()

    def flag(self, number: int) -> bool:
        """Whether a setting is on."""
        return float(self.memory[number]) != 0

    @property
    def inches(self) -> bool:
        """Whether positions are reported in inches."""
        return self.flag(13)

    def place(self, now_ns: int) -> Vector:
        """Machine coordinates now."""
        return plus(self.world.motor_at(now_ns), self.origin, -1.0)

    def planned(self, now_ns: int) -> Vector:
        """Machine coordinates after all queued motion."""
        return plus(self.planner.target(now_ns), self.origin, -1.0)

    def target(self, command: Command, now_ns: int) -> Vector:
        """The target of a motion command in machine coordinates."""
        found = list(self.planned(now_ns))
        relative = command.modal.distance == 91 and command.non_modal != 53.0
        for axis, value in command.axes.items():
            found[axis] = value + (found[axis] if relative else 0.0)
        return (found[0], found[1], found[2])

    def block(self, target: Vector, feed_mm_min: float | None) -> Block:
        """A straight line to machine coordinates."""
        rates = axes_of(self.memory, 110)
        feed = None if feed_mm_min is None else feed_mm_min / 60
        rates_mm_s = (rates[0] / 60, rates[1] / 60, rates[2] / 60)
        return Block(plus(target, self.origin), feed, rates_mm_s, axes_of(self.memory, 120))

    def beyond_travel(self, target: Vector) -> bool:
        """Whether soft limits forbid a target: every axis goes from minus its travel to 0."""
        if not self.flag(20):
            return False
        travel = axes_of(self.memory, 130)
        return any(not -most <= value <= 0.0 for value, most in zip(target, travel, strict=True))

    def write(self, number: int, text: str) -> None:
        """Change a setting, as ``$n=v`` does."""
        try:
            value = float(text)
        except ValueError as error:
            raise GrblError(3) from error
        if value < 0:
            raise GrblError(4)
        if number not in self.memory:
            raise GrblError(3)
        if (number == 20 and value and not self.flag(22)) or (number == 22 and not value and self.flag(20)):
            raise GrblError(10)
        self.writes += 1
        self.memory[number] = f'{value:.3f}' if '.' in self.memory[number] else f'{value:.0f}'
