"""The one scene that every emulated device shares: where the tip is, what it feels, and the digital line.

Everything is a function of time, for the past as for the present, so that a sensor may ask where the tip was when
its sample was taken. Coordinates are the machine's own after homing: millimetres, x to the right, y to the back,
z up, the end switches at the upper ends (Grbl's custom), so the whole room is negative. The gel's surface frame is
parallel to it: x_gel = x - gel_x_mm, y_gel = y - gel_y_mm.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel
from tactile_nodes.emulators.motion import Segment, Timeline, Vector, line, plus
from tactile_nodes.params import parameter
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import INDENTERS, indenter_name
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.memory import Memory, Shape
from tactile_nodes.simulation.optics import Press

Wrench = tuple[float, float, float, float, float, float]

NOTHING: Wrench = (0.0,) * 6
ACCELERATION_MM_S2: Vector = (200.0, 200.0, 200.0)
STIFF_N_PER_MM = 100.0  # the stiff layer under the gel, which a crash runs into


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


@dataclass(frozen=True)
class WorldSettings:
    """Where things stand in the machine's room."""

    room_mm: tuple[float, ...] = parameter((120.0, 120.0, 60.0), 'x, y, z from the lower to the upper end switches')
    start_mm: tuple[float, ...] = parameter((-50.0, -70.0, -8.0), 'x, y, z of the tip when the world begins')
    gel_x_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    gel_y_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    gel_z_mm: float = parameter(-30.0, "height of the surface at the gel's centre")
    slope_x: float = parameter(0.0, 'rise of the surface along x, mm per mm', minimum=-0.2, maximum=0.2)
    slope_y: float = parameter(0.0, 'rise of the surface along y, mm per mm', minimum=-0.2, maximum=0.2)
    tool_mm: float = parameter(60.0, "from the tip up to the force/torque sensor's origin", minimum=0.0)
    probe_z_mm: float = parameter(-1000.0, 'height of a plate with a probe switch; -1000.0: there is none')
    gel: str = parameter('', "YAML file of the gel, or the name of one in config/gels; empty: the paper's gel")
    indenter: str = parameter('tip', "what presses: the gel's own tip, or another", choices=('tip', *INDENTERS))


class World:
    """One machine, one tip, one gel, one digital line. Any thread may ask; one controller moves it.

    Args:
        settings: where things stand, which gel, and what presses it.
        gel: instead of the one that the settings name.
        table: what the indenter does to the gel; looked up (`contact_table`) if it is left out.
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

    # What the machine's controller does.

    def move(self, segment: Segment) -> None:
        """The motors go along a line."""
        with self._lock:
            self._motor.append(segment)

    def go(self, target: Vector, feed_mm_s: float, time_ns: int) -> int:
        """The motors go on to a place once they have arrived where they were sent; gives the time of arrival."""
        with self._lock:
            start_ns = max(time_ns, self._motor.end_ns)
            segment = line(start_ns, self._motor.end, target, feed_mm_s, ACCELERATION_MM_S2)
            self._motor.append(segment)
            return segment.end_ns

    def brake(self, time_ns: int, deceleration: float | None = None) -> int:
        """The motors come to rest with a deceleration in mm/s², or on the spot; gives the time of rest."""
        with self._lock:
            return self._motor.brake(time_ns, deceleration)

    def motor_at(self, time_ns: int) -> Vector:
        """Where the motors' steps would have brought the tip if none had been lost."""
        with self._lock:
            return self._motor.position(time_ns)

    def motor_speed_at(self, time_ns: int) -> float:
        """How fast the motors go along their line, in mm/s."""
        with self._lock:
            return self._motor.speed(time_ns)

    def set_line(self, level: bool, time_ns: int) -> None:
        """Switch the digital line; no edge if it has that level."""
        with self._lock:
            if level != (self._edges[-1].level if self._edges else False):
                self._edges.append(Edge(time_ns, level))

    @property
    def tables(self) -> dict[str, ContactTable]:
        """What the indenter does to the gel."""
        return {self.settings.indenter: self._table}

    @property
    def indenter_name(self) -> str:
        """What records call it: 'sphere 1.2 mm'."""
        return indenter_name(self.gel.tip_radius_mm, self.settings.indenter)

    @property
    def room_mm(self) -> Vector:
        """The way from the lower to the upper end switch of each axis."""
        return as_vector(self.settings.room_mm)

    # What happens to the machine.

    def stick(self, axis: int, time_ns: int, stuck: bool = True) -> None:
        """From now on an axis (0, 1, 2) does not follow its motor, or does again; the steps in between are lost."""
        with self._lock:
            here, motor = self.tip_at(time_ns), self._motor.position(time_ns)
            moves = list(self._epochs[-1].moves)
            moves[axis] = 0.0 if stuck else 1.0
            self._epochs.append(_Epoch(time_ns, here, motor, as_vector(moves)))

    # What sensors feel.

    def tip_at(self, time_ns: int) -> Vector:
        """The lowest point of the tip in machine coordinates, were nothing in its way to bend it."""
        with self._lock:
            epoch = self._epochs[-1]
            if epoch.start_ns > time_ns and len(self._epochs) > 1:
                epoch = next((each for each in reversed(self._epochs) if each.start_ns <= time_ns), self._epochs[0])
            return epoch.tip(self._motor.position(time_ns))

    def press_at(self, time_ns: int) -> Press:
        """Place on the gel's surface and depth along the surface's normal; negative above it."""
        s, (x, y, z) = self.settings, self.tip_at(time_ns)
        gel_x, gel_y = x - s.gel_x_mm, y - s.gel_y_mm
        below = s.gel_z_mm + s.slope_x * gel_x + s.slope_y * gel_y - z
        return Press(gel_x, gel_y, below * self._slope[2], s.indenter)

    def presses_at(self, time_ns: int) -> tuple[Press, ...]:
        """What the renderer needs: the press, none where the tip is beside the gel or above it, and healing dents."""
        return tuple(press for press in self._shape_at(time_ns).presses if press.depth_mm > 0)

    def force_at(self, time_ns: int) -> float:
        """Contact force along the surface's normal in N, by contact table and settling; beyond both it rises on."""
        touch = self._touch_at(time_ns)
        if touch.depth_mm <= 0:
            return 0.0
        return self._shape_at(time_ns).force_n + self._beyond(touch.depth_mm)

    def wrench_at(self, time_ns: int) -> Wrench:
        """As `WrenchSource.wrench_at`: the tip does not go sideways, so the force is along the surface's normal."""
        force, (nx, ny, nz) = self.force_at(time_ns), self._slope
        if force == 0:
            return NOTHING
        arm_m = self.settings.tool_mm / 1000
        return force * nx, force * ny, force * nz, arm_m * force * ny, -arm_m * force * nx, 0.0

    def line_level(self, time_ns: int) -> bool:
        """As `LineSource.line_level`."""
        with self._lock:
            return next((edge.level for edge in reversed(self._edges) if edge.stamp_ns <= time_ns), False)

    def line_edges(self) -> Sequence[Edge]:
        """As `LineSource.line_edges`."""
        with self._lock:
            return tuple(self._edges)

    def probe_closed(self, time_ns: int) -> bool:
        """Whether the tip touches the plate of the probe switch."""
        return self.tip_at(time_ns)[2] <= self.settings.probe_z_mm

    def _normal(self) -> Vector:
        s = self.settings
        size = math.sqrt(1 + s.slope_x**2 + s.slope_y**2)
        return (-s.slope_x / size, -s.slope_y / size, 1 / size)

    def _beside(self, *place_mm: float) -> bool:
        """Whether a place lies beside the gel."""
        return not self.gel.rim.holds(np.array(place_mm))

    def _touch_at(self, time_ns: int) -> Press:
        """The press; beside the gel it is above nothing."""
        press = self.press_at(time_ns)
        if press.depth_mm > 0 and self._beside(press.x_mm, press.y_mm):
            return dataclasses.replace(press, depth_mm=-press.depth_mm)
        return press

    def _shape_at(self, time_ns: int) -> Shape:
        if self.gel.settling_share == 0:
            touch = self._touch_at(time_ns)
            return Shape((touch,), self._table.force_at(touch.depth_mm))
        with self._lock:
            return self._memory.at(time_ns)

    def _beyond(self, depth_mm: float) -> float:
        """The force that a press deeper than the table adds: as steep as at its end, and then the stiff layer's."""
        depth, force = self._table.depth_mm, self._table.force_n
        deeper = min(depth_mm, self.gel.layer_mm) - float(depth[-1])
        if deeper <= 0:
            return 0.0
        slope = float((force[-1] - force[-2]) / (depth[-1] - depth[-2]))
        return slope * deeper + STIFF_N_PER_MM * max(0.0, depth_mm - self.gel.layer_mm)


@dataclass(frozen=True)
class _Epoch:
    """A time in which the same axes follow their motors."""

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
