"""A parallel gripper that holds an object between two gels: its servo, and the object's effect on the gels."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.params import parameter
from tactile_nodes.sensors import HandSensor, Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.touch.gripping import Finger, Grip, Gripped, Hold

WIDTHS_MM = 25.0, 45.0


@dataclass(frozen=True)
class GripperSettings:
    """The gripper and the object between its fingers."""

    open_mm: float = parameter(50.0, 'distance of the fingers at the start, and the largest one', minimum=1.0)
    speed_mm_s: float = parameter(40.0, 'speed of the fingers', minimum=0.1)
    object_mm: float = parameter(0.0, 'width of the object; 0: random, 25 to 45', minimum=0.0)
    seed: int = parameter(-1, 'random seed; -1: another one each time', minimum=-1)
    friction: float = parameter(0.9, 'friction coefficient between the object and the gels', minimum=0.0)
    pull_n: float = parameter(
        0.0, 'final force that pulls the object along z of the hand [N]', minimum=0.0, read_only=False
    )
    pull_after_s: float = parameter(3.0, 'how long the object is held before it is pulled', minimum=0.0)
    pull_n_s: float = parameter(0.2, 'rate at which the pull rises and falls [N/s]', minimum=0.01)

    def __post_init__(self) -> None:
        if self.object_mm >= self.open_mm:
            raise ValueError(f'object_mm is {self.object_mm:g}, and the fingers open to {self.open_mm:g} mm (open_mm)')


class Gripper:
    """Follows commands at its speed; `advance` returns how the object is held.

    Only a gripped object is pulled; until then it does not move. It is lost once it has slid out.
    """

    def __init__(self, settings: GripperSettings, fingers: Sequence[Finger], start_ns: int) -> None:
        chance = random.Random(None if settings.seed < 0 else settings.seed)  # noqa: S311 - no secret
        self._settings = settings
        self._grip = Grip(fingers, Gripped(settings.object_mm or chance.uniform(*WIDTHS_MM), settings.friction))
        self.opening_mm = self._wanted_mm = settings.open_mm
        self._last_ns = start_ns
        self.held_s = self.pulled_n = 0.0

    @property
    def lost(self) -> bool:
        return self._grip.lost

    def command(self, opening_mm: float) -> None:
        """Set the target opening, clipped to the range of the gripper."""
        if math.isfinite(opening_mm):
            self._wanted_mm = min(max(opening_mm, 0.0), self._settings.open_mm)

    def advance(self, now_ns: int, pull_n: float) -> Hold:
        """Simulate up to a time; `pull_n` is the final pulling force."""
        since_s, self._last_ns = (now_ns - self._last_ns) / NS_PER_S, now_ns
        self.opening_mm += _within(self._wanted_mm - self.opening_mm, self._settings.speed_mm_s * since_s)
        wanted_n = pull_n if self.held_s > self._settings.pull_after_s else 0.0
        self.pulled_n += _within(wanted_n - self.pulled_n, self._settings.pull_n_s * since_s)
        found = self._grip.hold(self.opening_mm, self.pulled_n, since_s)
        self.held_s = self.held_s + since_s if found.normal_n > 0 else 0.0
        self.pulled_n *= found.normal_n > 0
        return found


def finger_of(sensor: HandSensor) -> Finger:
    """The gel that a sensor of a hand describes.

    Raises:
        ConfigurationError: there is no such description.
    """
    return _finger(gel_of(load_sensor(sensor.sensor) if sensor.sensor else Sensor()))


@cache
def _finger(gel: Gel) -> Finger:
    """Both fingers of most grippers have the same gel, whose drag takes half a second to solve."""
    return Finger(gel, contact_table(gel))


def pull_along(sensor: HandSensor) -> tuple[float, float]:
    """The direction (x, y) of the pull, which is along z of the hand, on the surface of a sensor.

    For a finger that looks along the hand's -y (rpy 90, 0, 0 degrees) it is the sensor's y: (0, 1).
    """
    x, y, _ = sensor.frame.parent_from_surface[2, :3].tolist()
    return x, y


def touches(hold: Hold, along: Sequence[tuple[float, float]]) -> list[Press]:
    """The press on each finger's gel, given the direction (x, y) of the pull along its surface."""
    return [
        Press(hold.slid_mm * x, hold.slid_mm * y, depth_mm, shift_mm=(hold.drag_mm * x, hold.drag_mm * y))
        for depth_mm, (x, y) in zip(hold.depth_mm, along, strict=True)
    ]


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)
