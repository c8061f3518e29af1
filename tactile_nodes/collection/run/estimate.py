"""How long a plan takes, and how long the motions alone would take.

The estimate covers a campaign without faults: homing, the first zero, surface search, anchors, rest images, patterns of
the digital line, and presses. Each motion consists of jogs that come to rest, like those of the simulated machine. A
controller that joins jogs saves these stops, but needs time to respond. A gel that settles takes longer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tactile_nodes.collection.plan.journal import NO_PRESS
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.plan.progress import duration
from tactile_nodes.collection.press.cycle import LOOK_S
from tactile_nodes.collection.press.rest import LOOK_S as REST_LOOK_S
from tactile_nodes.collection.press.surface import BACK_OFF_STEPS, CORNERS
from tactile_nodes.collection.press.sync_pattern import pattern_gaps
from tactile_nodes.collection.press.up import UNLOADED_S
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.contract import CncSettings

ACCELERATION = 200.0  # mm/s² of each axis, if the machine does not report it
HOMING_S = 5.0
HOME_MM = -1.0  # where homing leaves each axis
USUAL_FPS = 60.0
FELT_MM = 0.15  # depth of the paper's tip when its force is detected


@dataclass(frozen=True)
class Estimate:
    """Estimate for a plan in its order.

    Attributes:
        presses: number of presses.
        seconds: of the whole run.
        each_s: mean time of one press of the plan.
        machine_s: of the motions of the presses alone, at the largest allowed feed, without any waiting.
    """

    presses: int
    seconds: float
    each_s: float
    machine_s: float

    def describe(self) -> str:
        return (
            f'{self.presses} presses, about {duration(self.seconds)} in total, {self.each_s:.1f} s per press; '
            f'the motions alone take {duration(self.machine_s)} at the largest feed'
        )


def estimate(
    plan_id: str,
    order: Sequence[Point],
    settings: CollectionSettings,
    cnc: CncSettings,
    surface_z_mm: float,
    fps: float = USUAL_FPS,
) -> Estimate:
    """Times of a plan on a machine that moves sideways at `cnc.safe_z_mm`, with the gel's surface below that."""
    course = Course(settings, cnc.safe_z_mm, surface_z_mm, fps)
    others_s = course.begin_s() + course.surface_s() + course.rests_s(len(order)) + patterns_s(plan_id, order, settings)
    pressed = [course.press_s(before, point) for before, point in pairwise(pressed_points(order, settings))]
    own = [course.press_s(before, point) for before, point in pairwise((order[0], *order))]
    high_mm, fastest = cnc.safe_z_mm - surface_z_mm, cnc.fastest_mm_min
    machine_s = sum(
        leg_s(math.dist(before[1:3], point[1:3]), fastest) + 2 * leg_s(high_mm + point.depth_mm, fastest)
        for before, point in pairwise((order[0], *order))
    )
    return Estimate(len(order), others_s + sum(pressed), sum(own) / len(own), machine_s)


def pressed_points(order: Sequence[Point], settings: CollectionSettings) -> Iterator[Point]:
    """Places where the tip goes down, anchors included; the first is the corner of the last surface search."""
    anchor, reach = settings.anchor, settings.surface.reach_mm
    x, y = CORNERS[settings.surface.corners - 1]
    yield Point(NO_PRESS, x * reach, y * reach, 0.0)
    again = Point(NO_PRESS, anchor.x_mm, anchor.y_mm, anchor.depth_mm)
    if anchor.every:
        step = anchor.step_mm
        yield from (again, again._replace(x_mm=again.x_mm + step), again._replace(y_mm=again.y_mm + step), again)
    for number, point in enumerate(order):
        if anchor.every and number and number % anchor.every == 0:
            yield again
        yield point
    if anchor.every:
        yield again


def patterns_s(plan_id: str, order: Sequence[Point], settings: CollectionSettings) -> float:
    """Time of the irregular patterns at the start, after every so many presses, and at the end."""
    between = (len(order) - 1) // settings.sync.every if settings.sync.every else 0
    return sum(sum(pattern_gaps(plan_id, number, 2 * settings.sync.pulses)) for number in range(between + 2))


class Course:
    """Duration of each part of a run on the simulated machine.

    Args:
        settings: of the collection.
        safe_z_mm: height for sideways motion.
        surface_z_mm: height of the gel.
        fps: frame rate of the camera.
    """

    def __init__(self, settings: CollectionSettings, safe_z_mm: float, surface_z_mm: float, fps: float) -> None:
        self._settings = settings
        self._safe_z_mm = safe_z_mm
        self._high_mm = safe_z_mm - surface_z_mm
        self._top_mm = settings.surface.top_mm - surface_z_mm
        self._fps = fps

    def press_s(self, before: Point, point: Point) -> float:
        """One press, from above the place of the previous one."""
        motion, press = self._settings.motion, self._settings.press
        standoff_mm = min(motion.standoff_mm, self._high_mm)
        ways_s = (
            self._over_s(point.x_mm - before.x_mm, point.y_mm - before.y_mm)
            + self._along_s(self._high_mm - standoff_mm, motion.approach_mm_min)
            + self._along_s(standoff_mm + point.depth_mm, motion.press_mm_min)
            + self._along_s(self._high_mm + point.depth_mm, motion.travel_mm_min)
        )
        # The window ends with the first look after its last sample, on average half a look later.
        window_s = looks_s(max(press.window_s, press.frames / self._fps) + LOOK_S / 2, LOOK_S)
        return ways_s + press.tare_s + looks_s(press.steady_s, LOOK_S) + window_s + UNLOADED_S

    def begin_s(self) -> float:
        """Until the first zero: waiting for devices, homing, moving above the centre of the gel."""
        s = self._settings
        way_s = self._over_s(s.surface.gel_x_mm - HOME_MM, s.surface.gel_y_mm - HOME_MM)
        down_s = self._along_s(HOME_MM - self._safe_z_mm, s.motion.approach_mm_min)
        return s.limits.steady_again_s + HOMING_S + way_s + down_s + 2 * s.press.tare_s

    def surface_s(self) -> float:
        """Surface search at the corners."""
        s, reach = self._settings.surface, self._settings.surface.reach_mm
        corners = CORNERS[: s.corners]
        ways_s = sum(
            self._over_s((x - a) * reach, (y - b) * reach) for (a, b), (x, y) in pairwise(((0.0, 0.0), *corners))
        )
        return ways_s + len(corners) * self._corner_s()

    def rests_s(self, presses: int) -> float:
        """Rest images: one for the noise, one before the first press, and one after every so many."""
        s = self._settings
        one_s = s.press.steady_s + looks_s(s.reference_frames / self._fps, REST_LOOK_S)
        return one_s * (2 + (presses - 1) // s.reference_every)

    def _corner_s(self) -> float:
        s, motion = self._settings.surface, self._settings.motion
        above_mm = min(self._top_mm, BACK_OFF_STEPS * s.fine_step_mm)
        seconds, deepest_mm = self._search_s(self._top_mm, s.step_mm)
        for _ in range(s.repeats):
            seconds += self._along_s(above_mm + deepest_mm, motion.press_mm_min)
            again_s, deepest_mm = self._search_s(above_mm, s.fine_step_mm)
            seconds += again_s
        seconds += self._along_s(self._high_mm - self._top_mm, motion.approach_mm_min)
        return seconds + self._along_s(self._high_mm + deepest_mm, motion.approach_mm_min) + self._settings.press.tare_s

    def _search_s(self, above_mm: float, step_mm: float) -> tuple[float, float]:
        """Time of a search that starts this far above the surface, and its final depth."""
        s = self._settings.surface
        steps = math.ceil((above_mm + FELT_MM) / step_mm - 1e-9) + s.beyond
        return steps * (self._along_s(step_mm, s.feed_mm_min) + s.dwell_s), steps * step_mm - above_mm

    def _over_s(self, x_mm: float, y_mm: float) -> float:
        """Sideways; on a diagonal, both axes accelerate."""
        way_mm = math.hypot(x_mm, y_mm)
        share = max(abs(x_mm), abs(y_mm)) / way_mm if way_mm else 1.0
        return self._along_s(way_mm, self._settings.motion.travel_mm_min, ACCELERATION / share)

    def _along_s(self, length_mm: float, feed_mm_min: float, acceleration: float = ACCELERATION) -> float:
        """In jogs, each from rest to rest."""
        jogs = max(1, math.ceil(length_mm / (feed_mm_min / 60 * self._settings.motion.jog_s) - 1e-9))
        return jogs * leg_s(length_mm / jogs, feed_mm_min, acceleration)


def looks_s(seconds: float, look_s: float) -> float:
    """Time until the first look that is not earlier: 0.21 s in looks of 0.02 s are 0.22 s."""
    return math.ceil(seconds / look_s - 1e-9) * look_s


def leg_s(length_mm: float, feed_mm_min: float, acceleration: float = ACCELERATION) -> float:
    """From rest to rest along a line.

    10 mm at 600 mm/min with 200 mm/s² take 1 s and 0.05 s for acceleration and deceleration.
    """
    if length_mm <= 0:
        return 0.0
    speed = min(feed_mm_min / 60, math.sqrt(acceleration * length_mm))
    return length_mm / speed + speed / acceleration
