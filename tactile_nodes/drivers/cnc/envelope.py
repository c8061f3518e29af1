"""The rules of motion: a workspace, and no sideways motion while the tip is low."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.drivers.cnc.contract import CncSettings, Envelope, Place
from tactile_nodes.errors import ConfigurationError

TOLERANCE_MM = 0.002  # positions are reported to 0.001 mm
ROUNDING_MM = 0.02  # half a step of a coarse machine, and half of the 0.01 mm to which a Marlin reports
AXES = 'xyz'


@dataclass(frozen=True)
class Guard:
    """The rules for one machine."""

    envelope: Envelope
    safe_z_mm: float
    lateral_when_low: bool
    fastest_mm_min: float

    def check(self, start: Place, target: Place, feed: float) -> None:
        """Refuse a forbidden move. A tip that rests outside the workspace may go up, and back towards it.

        Raises:
            ConfigurationError: names the violated rule.
        """
        self._check_feed(feed)
        self._check_box(start, target)
        lateral = max(abs(target[0] - start[0]), abs(target[1] - start[1]))
        low = min(start[2], target[2])
        if lateral > TOLERANCE_MM and low < self.safe_z_mm - ROUNDING_MM and not self.lateral_when_low:
            raise ConfigurationError(
                f'refused to move sideways by {lateral:g} mm at z {low:g} mm, below the safe height of '
                f'{self.safe_z_mm:g} mm; move up first, or set lateral_when_low'
            )

    def nearest(self, target: Place) -> Place:
        """A target just outside the workspace, where rounding to steps has left the tip, as one inside.

        The controller would refuse it, even for a way straight up.
        """
        box = zip(target, self.envelope.lowest_mm, self.envelope.highest_mm, strict=True)
        x, y, z = (
            min(max(value, low), high) if low - ROUNDING_MM <= value <= high + ROUNDING_MM else value
            for value, low, high in box
        )
        return (x, y, z)

    def check_up(self, way: Place, feed: float) -> None:
        """From an unknown position, refuse any move except straight up.

        Raises:
            ConfigurationError: it is another move.
        """
        self._check_feed(feed)
        if way[0] or way[1] or way[2] <= 0:
            raise ConfigurationError('the position is unknown, so the tip may only go straight up; home first')

    def _check_feed(self, feed: float) -> None:
        if not 0 < feed <= self.fastest_mm_min:
            raise ConfigurationError(
                f'refused to move at {feed:g} mm/min; the feed must be above 0 and at most {self.fastest_mm_min:g}'
            )

    def _check_box(self, start: Place, target: Place) -> None:
        box = zip(AXES, start, target, self.envelope.lowest_mm, self.envelope.highest_mm, strict=True)
        for axis, begin_mm, value, low, high in box:
            if not min(low - TOLERANCE_MM, begin_mm) <= value <= max(high + TOLERANCE_MM, begin_mm):
                raise ConfigurationError(f'refused to move to {axis} {value:g} mm; the range is {low:g} to {high:g}')


def guard(settings: CncSettings, machine: Envelope | None) -> Guard:
    """The rules from the settings and the machine's own limits: the intersection of both workspaces.

    Raises:
        ConfigurationError: no workspace, an empty one, or a safe height outside it.
    """
    lowest = as_place(settings.lowest_mm) or (machine.lowest_mm if machine else None)
    highest = as_place(settings.highest_mm) or (machine.highest_mm if machine else None)
    if lowest is None or highest is None:
        raise ConfigurationError('this machine does not report its limits; set lowest_mm and highest_mm')
    if machine is not None:
        lowest = _each(max, lowest, machine.lowest_mm)
        highest = _each(min, highest, machine.highest_mm)
    if not all(math.isfinite(low) and low < high for low, high in zip(lowest, highest, strict=True)):
        raise ConfigurationError(
            f'the workspace from {lowest} to {highest} mm is empty; correct lowest_mm and highest_mm'
        )
    if not lowest[2] <= settings.safe_z_mm <= highest[2]:
        raise ConfigurationError(
            f'safe_z_mm is {settings.safe_z_mm:g}, outside the range of z, '
            f'{lowest[2]:g} to {highest[2]:g} mm; set it to a height above the gel'
        )
    return Guard(Envelope(lowest, highest), settings.safe_z_mm, settings.lateral_when_low, settings.fastest_mm_min)


def as_place(values: tuple[float, ...]) -> Place | None:
    """Three numbers as a place; None for no numbers."""
    return (values[0], values[1], values[2]) if len(values) == 3 else None


def _each(choose: Callable[[float, float], float], a: Place, b: Place) -> Place:
    x, y, z = (choose(one, other) for one, other in zip(a, b, strict=True))
    return (x, y, z)


def way_between(a: Place, b: Place) -> Place:
    """Vector from one place to another."""
    return (b[0] - a[0], b[1] - a[1], b[2] - a[2])


def describe_place(place: Place) -> str:
    """A place as text."""
    return ' '.join(f'{axis} {value:.3f}' for axis, value in zip(AXES, place, strict=True)) + ' mm'
