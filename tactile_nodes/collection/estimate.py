"""How long a plan takes, and how long the machine alone would need for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tactile_nodes.collection.cycle import UNLOADED_S
from tactile_nodes.collection.order import least_rest, travel_mm
from tactile_nodes.collection.plan import Point
from tactile_nodes.collection.progress import duration
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.sync_pattern import pattern_s
from tactile_nodes.drivers.cnc import CncSettings

ACCELERATION = 200.0  # mm/s², where the machine is not asked
USUAL_FPS = 60.0


@dataclass(frozen=True)
class Estimate:
    """Of a plan in its order.

    Attributes:
        seconds: of all presses and sync patterns, without finding the surface.
        machine_s: of the motions alone, at the greatest feed that is allowed, without any waiting.
        travel_mm: the way over the gel.
        least_rest: the least number of presses between two that are near to each other.
    """

    presses: int
    seconds: float
    machine_s: float
    travel_mm: float
    least_rest: int

    def told(self) -> str:
        """Two lines for a person."""
        return (
            f'{self.presses} presses, {self.travel_mm / 1000:.1f} m over the gel; neighbours rest for at least '
            f'{self.least_rest} presses\n'
            f'about {duration(self.seconds)} ({self.seconds / self.presses:.1f} s each); the machine alone would need '
            f'{duration(self.machine_s)} for these motions at its greatest feed'
        )


def estimate(
    order: Sequence[Point], settings: CollectionSettings, cnc: CncSettings, height_mm: float, rest_mm: float
) -> Estimate:
    """Times of a plan; `height_mm` is that of the safe height above the surface.

    10 mm at 600 mm/min with 200 mm/s² take 1 s and 0.05 s for speeding up and slowing down.
    """
    press, motion = settings.press, settings.motion
    waiting_s = press.tare_s + press.steady_s + max(press.window_s, press.frames / USUAL_FPS) + UNLOADED_S
    seconds = machine_s = 0.0
    for before, point in zip((order[0], *order), order, strict=False):
        way = math.dist(before[1:3], point[1:3])
        standoff = min(motion.standoff_mm, height_mm)
        seconds += leg_s(way, motion.travel_mm_min) + leg_s(height_mm - standoff, motion.approach_mm_min)
        seconds += leg_s(standoff + point.depth_mm, motion.press_mm_min)
        seconds += leg_s(height_mm + point.depth_mm, motion.travel_mm_min) + waiting_s
        machine_s += leg_s(way, cnc.fastest_mm_min) + 2 * leg_s(height_mm + point.depth_mm, cnc.fastest_mm_min)
    patterns = 2 + (len(order) - 1) // settings.sync.every if settings.sync.every else 2
    seconds += patterns * pattern_s(settings)
    return Estimate(len(order), seconds, machine_s, travel_mm(order), least_rest(order, rest_mm))


def leg_s(length_mm: float, feed_mm_min: float) -> float:
    """From rest to rest along a line."""
    if length_mm <= 0:
        return 0.0
    speed = min(feed_mm_min / 60, math.sqrt(ACCELERATION * length_mm))
    return length_mm / speed + speed / ACCELERATION
