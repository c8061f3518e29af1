"""A sensor and what happens to it, as a function of time alone.

Two processes that build the same scene see the same world at the same time without communicating: one renders the
camera image, the other computes the ground truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32, UInt8
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.memory import Memory
from tactile_nodes.simulation.optics import Optics, Press, Shaping, mix
from tactile_nodes.simulation.solution import solve_gel
from tactile_nodes.simulation.touch.table import Touch, TouchTable, node_forces, over_bins
from tactile_nodes.simulation.worlds import SharedWorld

NS_PER_S = 1_000_000_000
GAUSS_POINT = 0.5 / 3**0.5
"""Two moments this share of an exposure before and after its middle have the mean and variance of the exposure."""


@dataclass(frozen=True)
class Truth:
    """The ground truth. Bins are those of the surface at rest; all values are zero without contact.

    For a round tip (`by_place` is false) the whole force is in the bin of its centre, as the paper labels it. For other
    bodies each bin has the force that acts on it. `shear_force_n` is the force along x and y, `position_mm` the centre
    of the normal force, and `torsion_n_mm` the moment about z there.
    """

    normal_force_n: Float32[np.ndarray, 'rows cols']
    total_n: float
    position_mm: tuple[float, float]
    in_contact: bool
    shear_force_n: Float32[np.ndarray, 'rows cols 2']
    torsion_n_mm: float = 0.0
    by_place: bool = False

    @property
    def explanation(self) -> str:
        """The simplest explanation, as in `Acting`."""
        return ('field' if self.by_place else 'tips') if self.in_contact else 'nothing'

    @property
    def shear_n(self) -> tuple[float, float]:
        x, y = self.shear_force_n.sum(axis=(0, 1), dtype=float).tolist()
        return x, y


@runtime_checkable
class Schedule(Protocol):
    """The position of the tip, or of a body, over time."""

    def press_at(self, time_ns: int) -> Shaping: ...


@dataclass(frozen=True)
class PressSchedule:
    """A tip that presses the gel at one random place after another, forever.

    In every `period_s` it rests above the gel, comes down, dwells, goes up and moves on, with smooth motion. Place
    and depth of press number n follow from the seed and n, so that any time can be queried. Before `start_ns` nothing
    touches the gel.
    """

    seed: int = 1
    start_ns: int = 0
    period_s: float = 2.0
    reach_mm: float = 13.5
    shallowest_mm: float = 0.25
    deepest_mm: float = 2.0
    clearance_mm: float = 1.0
    phases: tuple[float, float, float, float] = field(default=(0.2, 0.4, 0.65, 0.85))
    """Shares of the period at which the tip starts down, arrives, starts up, and is up again."""

    def press_at(self, time_ns: int) -> Shaping:
        """Place and depth of the tip; a negative depth is its height above the gel."""
        since_ns = time_ns - self.start_ns
        if since_ns < 0:
            return Press(0.0, 0.0, -self.clearance_mm)
        number, within_ns = divmod(since_ns, round(self.period_s * NS_PER_S))
        share = within_ns / (self.period_s * NS_PER_S)
        place, deepest = self._target(number)
        x_mm, y_mm = self._travel(number, place, share)
        return Press(x_mm, y_mm, self._height(share, deepest))

    def _height(self, share: float, deepest_mm: float) -> float:
        down, bottom, lift, up = self.phases
        pressed = smooth((share - down) / (bottom - down)) - smooth((share - lift) / (up - lift))
        return -self.clearance_mm + pressed * (deepest_mm + self.clearance_mm)

    def _travel(self, number: int, place: tuple[float, float], share: float) -> tuple[float, float]:
        """The path from this place to the next while the tip is up; it ends with the period."""
        ahead, _ = self._target(number + 1)
        done = smooth((share - self.phases[3]) / (1 - self.phases[3]))
        return place[0] + done * (ahead[0] - place[0]), place[1] + done * (ahead[1] - place[1])

    def _target(self, number: int) -> tuple[tuple[float, float], float]:
        first = mix(self.seed) ^ (3 * number)
        u, v, w = (mix(first + each) / 2**64 for each in range(3))
        place = ((2 * u - 1) * self.reach_mm, (2 * v - 1) * self.reach_mm)
        return place, self.shallowest_mm + w * (self.deepest_mm - self.shallowest_mm)


@dataclass(frozen=True)
class TouchSchedule(PressSchedule):
    """Presses of the tip; at every n-th visit (`every`) a body is pressed, dragged, held and lifted instead.

    `bodies` give name, number of stages that press, and number of all stages. With `every` 1 there are bodies only. A
    body is lifted along the path that it came.
    """

    bodies: tuple[tuple[str, int, int], ...] = ()
    """Name, stages that press, stages in all."""
    every: int = 2
    touch_reach_mm: float = 8.0

    def press_at(self, time_ns: int) -> Shaping:
        """The press, or the touch during the visit of a body; it is above the gel while its stage is not above 0."""
        since_ns = time_ns - self.start_ns
        number, within_ns = divmod(since_ns, round(self.period_s * NS_PER_S))
        if since_ns < 0 or not self._is_touch(number):
            return super().press_at(time_ns)
        share = within_ns / (self.period_s * NS_PER_S)
        name, presses, stages = self.bodies[number // self.every % len(self.bodies)]
        place, _ = self._target(number)
        x_mm, y_mm = self._travel(number, place, share)
        turn_rad = math.tau * mix(mix(self.seed) ^ (3 * number + 1)) / 2**64
        return Touch(name, x_mm, y_mm, turn_rad, self._stage(share, presses, stages))

    def _is_touch(self, number: int) -> bool:
        return bool(self.bodies) and number % self.every == self.every - 1

    def _stage(self, share: float, presses: int, stages: int) -> float:
        """The stage of a body that is pressed, then dragged, held, and lifted."""
        down, bottom, lift, up = self.phases
        pressed = presses * smooth((share - down) / (0.5 * (bottom - down)))
        dragged = (stages - 1 - presses) * smooth((share - 0.5 * (down + bottom)) / (0.6 * (lift - down)))
        lifted = (stages - 1) * smooth((share - lift) / (up - lift))
        return pressed + dragged - lifted

    def _target(self, number: int) -> tuple[tuple[float, float], float]:
        place, depth = super()._target(number)
        if not self._is_touch(number):
            return place, depth
        nearer = self.touch_reach_mm / self.reach_mm
        return (place[0] * nearer, place[1] * nearer), depth


def smooth(share: float) -> float:
    """A smooth step from 0 to 1 without jerks at its ends: 10 s³ - 15 s⁴ + 6 s⁵, 0.5 at 0.5."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10 + s * (6 * s - 15))


class Scene:
    """One gel under one schedule, at any time: the camera image and the ground truth.

    In a gel that settles, earlier presses count too; the gel is assumed at rest some settling times before. Bodies
    other than tips leave no dents.
    """

    def __init__(
        self,
        gel: Gel | None = None,
        schedule: Schedule | None = None,
        bins: BinGrid | None = None,
        table: ContactTable | None = None,
        others: Mapping[str, ContactTable] | None = None,
        bodies: Mapping[str, TouchTable] | None = None,
    ) -> None:
        self.gel = gel or Gel()
        self.schedule: Schedule = schedule or PressSchedule()
        self.bins = bins or BinGrid(9, 9, *self.gel.sides_mm)
        self._table = table or solve_gel(self.gel)
        self._others, self.bodies = dict(others or {}), dict(bodies or {})
        self._optics: Optics | None = None
        self._memory = Memory(self.gel, self._tip_at, {'tip': self._table, **self._others})

    @property
    def optics(self) -> Optics:
        """The renderer, made with the first image: the ground truth does not need it."""
        if self._optics is None:
            self._optics = Optics(self.gel, self._table, self._others, self.bodies)
        return self._optics

    def _tip_at(self, time_ns: int) -> Press:
        """The tip in the schedule; it is above the gel while another body touches."""
        shaping = self.schedule.press_at(time_ns)
        return Press(shaping.x_mm, shaping.y_mm, -1.0) if isinstance(shaping, Touch) else shaping

    def render(self, time_ns: int) -> UInt8[np.ndarray, 'h w']:
        """The camera image whose exposure has its middle at `time_ns`."""
        off_ns = round(self.gel.exposure_s * NS_PER_S * GAUSS_POINT)
        moments = (time_ns,) if off_ns == 0 else (time_ns - off_ns, time_ns + off_ns)
        return self.optics.expose([self.presses_at(each) for each in moments], noise_seed=time_ns)

    def presses_at(self, time_ns: int) -> tuple[Shaping, ...]:
        """What deforms the gel at a time: the tip or a body, and the dents that tips left in a gel that settles."""
        shaping = self.schedule.press_at(time_ns)
        if self.gel.settling_share == 0:
            return (shaping,)
        dents = self._memory.at(time_ns).presses
        return (shaping, *dents) if isinstance(shaping, Touch) else dents

    def truth(self, time_ns: int) -> Truth:
        """The force on the gel at a time."""
        press = self.schedule.press_at(time_ns)
        if isinstance(press, Touch):
            return truth_of_touch(press, self.bodies[press.body], self.gel.shear_modulus_mpa, self.bins)
        force_n = None if self.gel.settling_share == 0 else self._memory.at(time_ns).force_n
        return truth_of(press, {'tip': self._table, **self._others}[press.indenter], self.bins, force_n)


class WorldScene(Scene):
    """A scene of a shared world that other code moves."""

    def __init__(self, world: SharedWorld, bins: BinGrid | None = None) -> None:
        super().__init__(world.gel, world, bins, table=next(iter(world.tables.values())), others=world.tables)
        self._world = world

    def presses_at(self, time_ns: int) -> tuple[Shaping, ...]:
        return self._world.presses_at(time_ns)

    def truth(self, time_ns: int) -> Truth:
        """The force on the world's gel; a tip beside or above it is reported over its middle."""
        press, force_n = self._world.press_at(time_ns), self._world.force_at(time_ns)
        if press.depth_mm <= 0 or force_n <= 0:
            press = Press(0.0, 0.0, min(press.depth_mm, 0.0), press.indenter)
        drag_n = self.optics.drag_n(press) if press.touching and any(press.shift_mm) else (0.0, 0.0)
        return truth_of(press, self._world.tables[press.indenter], self.bins, force_n, drag_n)


def truth_of(
    press: Press,
    table: ContactTable,
    bins: BinGrid,
    force_n: float | None = None,
    drag_n: tuple[float, float] = (0.0, 0.0),
) -> Truth:
    """The paper's label of one press: its force (from the table unless given) and its drag in the bin of its centre."""
    forces = np.zeros((bins.count, 3), np.float32)
    total_n = table.force_at(press.depth_mm) if force_n is None else force_n
    forces[bins.bin_of(press.x_mm, press.y_mm)] = *drag_n, total_n
    binned = forces.reshape(bins.rows, bins.cols, 3)
    return Truth(binned[..., 2], total_n, (press.x_mm, press.y_mm), press.touching, binned[..., :2])


def truth_of_touch(touch: Touch, table: TouchTable, shear_modulus_mpa: float, bins: BinGrid) -> Truth:
    """The forces under a body on its path, by place."""
    if not touch.touching:
        nothing = np.zeros((bins.rows, bins.cols, 3), np.float32)
        return Truth(nothing[..., 2], 0.0, (touch.x_mm, touch.y_mm), False, nothing[..., :2])
    place_mm, force = node_forces(table, touch)
    force = force * shear_modulus_mpa
    forces = over_bins(place_mm, force, table.node_size_mm, bins).astype(np.float32)
    total_n = float(force[:, 2].sum())
    centre = (place_mm * force[:, 2:]).sum(axis=0) / max(total_n, 1e-12)
    away = place_mm - centre
    torsion = float((away[:, 0] * force[:, 1] - away[:, 1] * force[:, 0]).sum())
    return Truth(forces[..., 2], total_n, (float(centre[0]), float(centre[1])), True, forces[..., :2], torsion, True)
