"""The scene that all emulated devices share: the position of the tip, the forces on it, and the digital line.

Everything is a function of time, past or present, so that a sensor can ask for the tip position at the time of its
sample. Coordinates are those of the machine after homing: millimetres, x to the right, y to the back, z up. The end
switches are at the upper ends (as usual for Grbl), so all coordinates are negative. The gel's surface frame is parallel
to it: x_gel = x - gel_x_mm, y_gel = y - gel_y_mm.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from tactile_nodes.clock import Clock
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.emulators.motion import Segment, Timeline, Vector, line, plus
from tactile_nodes.params import parameter
from tactile_nodes.simulation import worlds
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import INDENTERS
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.memory import Memory, Shape
from tactile_nodes.simulation.optics import Press

Wrench = tuple[float, float, float, float, float, float]

NOTHING: Wrench = (0.0,) * 6
ACCELERATION_MM_S2: Vector = (200.0, 200.0, 200.0)
STIFF_N_PER_MM = 100.0  # the stiff layer under the gel, hit in a crash


class Edge(NamedTuple):
    """A change of the digital line: its time, and the level after it."""

    stamp_ns: int
    level: bool


class WrenchSource(Protocol):
    """The load on a force/torque sensor."""

    def wrench_at(self, time_ns: int) -> Wrench:
        """(Fx, Fy, Fz, Tx, Ty, Tz) in N and N·m at a time on the clock's base, past or present.

        It is the load that the world exerts ON the sensor's tool side. The axes are parallel to the machine's (z up,
        out of the gel), and torques are about the sensor's origin. Pressing the gel straight down gives Fz > 0, and
        free hanging gives zero. The emulated sensor accounts for its mounting (an ATI whose z points to the tool reads
        the negative).
        """
        ...


@dataclass(frozen=True)
class UpsideDown:
    """The load on a sensor that hangs from the machine with z pointing to the tool, in its axes: half a turn about x.

    A force of (1, 2, 3) N reads (1, -2, -3) N.
    """

    world: WrenchSource

    def wrench_at(self, time_ns: int) -> Wrench:
        fx, fy, fz, tx, ty, tz = self.world.wrench_at(time_ns)
        return fx, -fy, -fz, tx, -ty, -tz


@dataclass(frozen=True)
class WorldSettings:
    """Positions in the machine's coordinates."""

    room_mm: tuple[float, ...] = parameter((120.0, 120.0, 60.0), 'x, y, z from the lower to the upper end switches')
    start_mm: tuple[float, ...] = parameter((-50.0, -70.0, -8.0), 'x, y, z of the tip when the world begins')
    gel_x_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    gel_y_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    gel_z_mm: float = parameter(-30.0, "height of the surface at the gel's centre")
    slope_x: float = parameter(0.0, 'rise of the surface along x, mm per mm', minimum=-0.2, maximum=0.2)
    slope_y: float = parameter(0.0, 'rise of the surface along y, mm per mm', minimum=-0.2, maximum=0.2)
    tool_mm: float = parameter(60.0, "from the tip up to the force/torque sensor's origin", minimum=0.0)
    gel: str = parameter('', "YAML file of the gel, or the name of one in config/gels; empty: the paper's gel")
    indenter: str = parameter('tip', "what presses: the gel's own tip, or another", choices=('tip', *INDENTERS))

    def __post_init__(self) -> None:
        if len(self.start_mm) != 3:
            raise ValueError(f'start_mm must be three numbers, got {len(self.start_mm)}')
        if len(self.room_mm) != 3 or min(self.room_mm) <= 0:
            raise ValueError(f'room_mm must be three numbers above 0, got {self.room_mm}')


class World:
    """One machine, one tip, one gel, one digital line. Any thread may query it; one controller moves it.

    Args:
        settings: positions, gel and indenter.
        gel: replaces the gel of the settings.
        table: the indenter's contact table on the gel; by default from `contact_table`.
    """

    def __init__(
        self, settings: WorldSettings | None = None, gel: Gel | None = None, table: ContactTable | None = None
    ) -> None:
        self.settings = settings or WorldSettings()
        self.gel = gel or load_gel(self.settings.gel)
        self._table = table or contact_table(self.gel, self.settings.indenter)
        self._slope = self._normal()
        self._lock = threading.RLock()
        self._memory = Memory(self.gel, self._touch_at, self.tables)
        start = as_vector(self.settings.start_mm)
        self._motor = Timeline(start)
        self._epochs = [_Epoch(0, start, start, (1.0, 1.0, 1.0))]
        self._edges: list[Edge] = []

    # Actions of the machine's controller.

    def move(self, segment: Segment) -> None:
        with self._lock:
            self._motor.append(segment)

    def go(self, target: Vector, feed_mm_s: float, time_ns: int) -> int:
        """Move the motors to a place after the moves so far; returns the time of arrival."""
        with self._lock:
            start_ns = max(time_ns, self._motor.end_ns)
            segment = line(start_ns, self._motor.end, target, feed_mm_s, ACCELERATION_MM_S2)
            self._motor.append(segment)
            return segment.end_ns

    def brake(self, time_ns: int, deceleration: float | None = None) -> int:
        """Stop the motors with a deceleration in mm/s², or at once; returns the time of rest."""
        with self._lock:
            return self._motor.brake(time_ns, deceleration)

    def motor_at(self, time_ns: int) -> Vector:
        """The position of the tip according to the motors' steps, as if none had been lost."""
        with self._lock:
            return self._motor.position(time_ns)

    def motor_speed_at(self, time_ns: int) -> float:
        """The speed of the motors along their line, in mm/s."""
        with self._lock:
            return self._motor.speed(time_ns)

    def set_line(self, level: bool, time_ns: int) -> None:
        """Switch the digital line; there is no edge if it already has that level."""
        with self._lock:
            if level != (self._edges[-1].level if self._edges else False):
                self._edges.append(Edge(time_ns, level))

    @property
    def tables(self) -> dict[str, ContactTable]:
        """The contact tables of the indenter on the gel."""
        return {self.settings.indenter: self._table}

    @property
    def room_mm(self) -> Vector:
        """The travel of each axis between its end switches."""
        return as_vector(self.settings.room_mm)

    # Faults of the machine.

    def stick(self, axis: int, time_ns: int, stuck: bool = True) -> None:
        """Make an axis (0, 1, 2) stop following its motor, or follow it again; the steps in between are lost."""
        with self._lock:
            tip_mm, motor = self.tip_at(time_ns), self._motor.position(time_ns)
            moves = list(self._epochs[-1].moves)
            moves[axis] = 0.0 if stuck else 1.0
            self._epochs.append(_Epoch(time_ns, tip_mm, motor, as_vector(moves)))

    # Input of the sensors.

    def tip_at(self, time_ns: int) -> Vector:
        """The lowest point of the tip in machine coordinates, without bending by contact."""
        with self._lock:
            epoch = self._epochs[-1]
            if epoch.start_ns > time_ns and len(self._epochs) > 1:
                epoch = next((each for each in reversed(self._epochs) if each.start_ns <= time_ns), self._epochs[0])
            return epoch.tip(self._motor.position(time_ns))

    def press_at(self, time_ns: int) -> Press:
        """The position on the gel's surface and the depth along its normal; negative above it."""
        return Press(*self._on_gel(time_ns), self.settings.indenter)

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:
        """The presses to render: the tip, unless it is beside or above the gel, and dents that recover."""
        return tuple(press for press in self._shape_at(time_ns, self._touch_at(time_ns)).presses if press.depth_mm > 0)

    def force_at(self, time_ns: int) -> float:
        """Contact force along the surface's normal in N, by contact table and settling; it rises beyond the table."""
        if self._on_gel(time_ns)[2] <= 0:  # the usual case, which is faster this way
            return 0.0
        touch = self._touch_at(time_ns)
        if touch.depth_mm <= 0:
            return 0.0
        return self._shape_at(time_ns, touch).force_n + self._beyond(touch.depth_mm)

    def wrench_at(self, time_ns: int) -> Wrench:
        """See `WrenchSource.wrench_at`. The tip does not move sideways, so the force is along the surface's normal."""
        force, (nx, ny, nz) = self.force_at(time_ns), self._slope
        if force == 0:
            return NOTHING
        arm_m = self.settings.tool_mm / 1000
        return force * nx, force * ny, force * nz, arm_m * force * ny, -arm_m * force * nx, 0.0

    def line_level(self, time_ns: int) -> bool:
        """Whether the digital line was high at a time; low before the first edge."""
        with self._lock:
            return next((edge.level for edge in reversed(self._edges) if edge.stamp_ns <= time_ns), False)

    def line_edges(self) -> Sequence[Edge]:
        """Every change of the digital line so far, in order of time; the first is a rise."""
        with self._lock:
            return tuple(self._edges)

    def _normal(self) -> Vector:
        s = self.settings
        size = math.sqrt(1 + s.slope_x**2 + s.slope_y**2)
        return (-s.slope_x / size, -s.slope_y / size, 1 / size)

    def _on_gel(self, time_ns: int) -> Vector:
        """x, y and depth of the tip in the gel's frame."""
        s, (x, y, z) = self.settings, self.tip_at(time_ns)
        gel_x, gel_y = x - s.gel_x_mm, y - s.gel_y_mm
        below = s.gel_z_mm + s.slope_x * gel_x + s.slope_y * gel_y - z
        return (gel_x, gel_y, below * self._slope[2])

    def _beside(self, *place_mm: float) -> bool:
        """Whether a place lies beside the gel."""
        return not self.gel.rim.holds(np.array(place_mm))

    def _touch_at(self, time_ns: int) -> Press:
        """The press; beside the gel its depth is negative."""
        press = self.press_at(time_ns)
        if press.depth_mm > 0 and self._beside(press.x_mm, press.y_mm):
            return dataclasses.replace(press, depth_mm=-press.depth_mm)
        return press

    def _shape_at(self, time_ns: int, touch: Press) -> Shape:
        if self.gel.settling_share == 0:
            return Shape((touch,), self._table.force_at(touch.depth_mm))
        with self._lock:
            return self._memory.at(time_ns)

    def _beyond(self, depth_mm: float) -> float:
        """The force added by a press deeper than the table: first with its final slope, then with the stiff layer's."""
        depth, force = self._table.depth_mm, self._table.force_n
        deeper = min(depth_mm, self.gel.layer_mm) - float(depth[-1])
        if deeper <= 0:
            return 0.0
        slope = float((force[-1] - force[-2]) / (depth[-1] - depth[-2]))
        return slope * deeper + STIFF_N_PER_MM * max(0.0, depth_mm - self.gel.layer_mm)


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


@dataclass(frozen=True)
class _Epoch:
    """A period in which the set of axes that follow their motors does not change."""

    start_ns: int
    from_tip: Vector
    from_motor: Vector
    moves: Vector

    def tip(self, motor: Vector) -> Vector:
        way = plus(motor, self.from_motor, -1.0)
        return plus(self.from_tip, (way[0] * self.moves[0], way[1] * self.moves[1], way[2] * self.moves[2]))


def as_vector(values: Sequence[float]) -> Vector:
    """Three numbers as a vector."""
    x, y, z = values
    return (x, y, z)
