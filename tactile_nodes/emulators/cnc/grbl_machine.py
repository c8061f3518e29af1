"""The machine as Grbl represents it: settings, coordinates, modal state, planner."""

from __future__ import annotations

from tactile_nodes.emulators.cnc.grbl_code import Command, GrblError, Modal
from tactile_nodes.emulators.cnc.grbl_dialect import DIALECTS, GrblSettings, axes_of
from tactile_nodes.emulators.cnc.grbl_report import coordinates
from tactile_nodes.emulators.cnc.planner import Block, Planner
from tactile_nodes.emulators.motion import Vector, plus
from tactile_nodes.emulators.world import World

ZERO: Vector = (0.0, 0.0, 0.0)


class GrblMachine:
    """The state of one machine in its controller. `origin` is machine zero in the world's coordinates."""

    def __init__(self, world: World, settings: GrblSettings, now_ns: int) -> None:
        self.world = world
        self.dialect = DIALECTS[settings.dialect]
        self.memory = settings.memory()
        self.planner = Planner(world, self.dialect.planner_blocks)
        self.origin = world.motor_at(now_ns)
        self.systems: dict[int, Vector] = dict.fromkeys(range(54, 60), ZERO)
        self.homes: dict[float, Vector] = {28.0: ZERO, 30.0: ZERO}
        self.writes = 0
        self.reset()

    def reset(self) -> None:
        """Set everything that a soft reset clears."""
        self.modal = Modal()
        self.shift: Vector = ZERO  # of G92
        self.probed: tuple[Vector, bool] = (ZERO, False)

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

    @property
    def offset(self) -> Vector:
        """Machine minus work coordinates."""
        return plus(self.systems[self.modal.system], self.shift)

    def target(self, command: Command, now_ns: int) -> Vector:
        """The target of a motion command in machine coordinates."""
        start, offset = self.planned(now_ns), self.offset
        found = list(start)
        for axis, value in command.axes.items():
            if command.non_modal == 53.0:
                found[axis] = value
            elif command.modal.distance == 91:
                found[axis] = start[axis] + value
            else:
                found[axis] = offset[axis] + value
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

    def set_offset(self, command: Command, now_ns: int) -> None:
        """Execute G10 L2 and L20, G92 and G92.1, G28.1 and G30.1."""
        place = self.planned(now_ns)
        if command.non_modal in {28.1, 30.1}:
            self.homes[float(int(command.non_modal))] = place
        elif command.non_modal == 92.1:
            self.shift = ZERO
        elif command.non_modal == 92.0:
            self.shift = _with(self.shift, command.axes, plus(place, self.systems[self.modal.system], -1.0), sign=-1.0)
        else:
            self._set_system(command, place)

    def _set_system(self, command: Command, place: Vector) -> None:
        form, number = command.values.get('L', 0.0), int(command.values.get('P', 0.0))
        system = self.modal.system if number == 0 else 53 + number
        if form not in {2.0, 20.0} or system not in self.systems:
            raise GrblError(20)
        base, sign = (ZERO, 1.0) if form == 2.0 else (plus(place, self.shift, -1.0), -1.0)
        self.systems[system] = _with(self.systems[system], command.axes, base, sign)

    def parameters(self) -> list[str]:
        """The answer to ``$#``."""
        rows = [f'[G{number}:{self._text(place)}]' for number, place in self.systems.items()]
        rows += [f'[G{number:.0f}:{self._text(place)}]' for number, place in self.homes.items()]
        return [*rows, f'[G92:{self._text(self.shift)}]', '[TLO:0.000]', self.probe_report()]

    def probe_report(self) -> str:
        """The report of the last probe cycle."""
        place, success = self.probed
        return f'[PRB:{self._text(place)}:{int(success)}]'

    def _text(self, place: Vector) -> str:
        return coordinates(place, self.inches)


def _with(old: Vector, axes: dict[int, float], base: Vector, sign: float) -> Vector:
    x, y, z = (base[axis] + sign * axes[axis] if axis in axes else old[axis] for axis in range(3))
    return (x, y, z)
