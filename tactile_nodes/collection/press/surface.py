"""Height of the gel's surface: measured at three or four corners, with a plane fitted through them.

At each corner the tip goes down in steps, with a force reading after each, until the force exceeds the tare by five
sigma and a minimum. It backs off and repeats that with smaller steps. After contact it goes a few steps further. The
loading line F^(2/3) over depth (a sphere on an elastic body, Hertz), or F for a flat punch, is extrapolated to F = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tactile_nodes.collection.actions import Go, Look, Observation, Procedure
from tactile_nodes.collection.press.rest import zero
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare, pressing_n, wrenches
from tactile_nodes.errors import ConfigurationError, DeviceFaultError

HERTZ, FLAT = 2 / 3, 1.0  # powers of the force that are linear in the depth
BACK_OFF_STEPS = 6
FEWEST = 3
CORNERS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


class Loading(NamedTuple):
    """F^power is `slope` times the depth below `touch_mm`: 0.5 with a power of 2/3 gives 0.35 N at 1 mm."""

    touch_mm: float
    slope: float
    power: float

    def force_n(self, depth_mm: float) -> float:
        """Force at a depth below the contact point."""
        return float((self.slope * max(depth_mm, 0.0)) ** (1 / self.power))


@dataclass(frozen=True)
class Surface:
    """A plane: height of the untouched surface in machine coordinates as a function of the gel's x and y, all in mm.

    `softest` is the loading line of the corner with the smallest force; None: no corner was measured.
    """

    z_mm: float
    slope_x: float = 0.0
    slope_y: float = 0.0
    softest: Loading | None = None

    def height_mm(self, x_mm: float, y_mm: float) -> float:
        """Height of the surface at a place; 0.01 mm/mm along x is 0.1 mm at x = 10 mm."""
        return self.z_mm + self.slope_x * x_mm + self.slope_y * y_mm

    def tip_mm(self, x_mm: float, y_mm: float, depth_mm: float) -> float:
        """Height of a tip that is `depth_mm` deep along the normal."""
        return self.height_mm(x_mm, y_mm) - depth_mm * self._steepness

    def depth_mm(self, x_mm: float, y_mm: float, z_mm: float) -> float:
        """The inverse of `tip_mm`."""
        return (self.height_mm(x_mm, y_mm) - z_mm) / self._steepness

    def force_n(self, depth_mm: float) -> float:
        """Force of the softest corner at a depth, by its loading line; 0 if unknown."""
        return 0.0 if self.softest is None else self.softest.force_n(depth_mm)

    @property
    def _steepness(self) -> float:
        return math.sqrt(1 + self.slope_x**2 + self.slope_y**2)


class Corner(NamedTuple):
    """The result at a corner: its place on the gel, the height of the surface in mm, and each loading line."""

    x_mm: float
    y_mm: float
    z_mm: float
    lines: Sequence[Loading]


def corners(settings: CollectionSettings) -> Sequence[tuple[float, float]]:
    """Places where the surface is measured, on the gel in mm."""
    reach = settings.surface.reach_mm
    return [(x * reach, y * reach) for x, y in CORNERS[: settings.surface.corners]]


def check_safe_height(settings: CollectionSettings, safe_z_mm: float) -> None:
    """Refuse a safe height below the height from which the surface search starts: the tip might already be in the gel.

    Raises:
        ConfigurationError: names both heights.
    """
    if safe_z_mm < settings.surface.top_mm:
        raise ConfigurationError(
            f'cnc.safe_z_mm is {safe_z_mm:g} mm, below surface.top_mm, {settings.surface.top_mm:g} mm, so the tip '
            'could move sideways in the gel; raise cnc.safe_z_mm'
        )


def check_search_depth(settings: CollectionSettings) -> None:
    """Refuse a search that goes deeper than `limits.depth_mm`. The first step into the gel may not be felt yet.

    Raises:
        ConfigurationError: names both depths.
    """
    surface = settings.surface
    deepest_mm = (surface.beyond + 1) * max(surface.step_mm, surface.fine_step_mm)
    if deepest_mm > settings.limits.depth_mm + 1e-9:
        raise ConfigurationError(
            f'the surface search goes {deepest_mm:g} mm deep (a step to contact and surface.beyond more), '
            f'limits.depth_mm allows {settings.limits.depth_mm:g}; change one of them, or surface.step_mm'
        )


def feel_corner(
    settings: CollectionSettings,
    safe_z_mm: float,
    at: tuple[float, float],
    felt: Sequence[Corner],
    found: list[Loading],
) -> Procedure[Corner]:
    """Measure the height of the surface at one corner.

    Args:
        settings: speeds, steps and limits.
        safe_z_mm: height for sideways motion.
        at: the corner.
        felt: the corners before it.
        found: its loading lines, first of the coarse search, then of the repeats. New lines are appended. After a
            restart because a device became silent, lines already in it are not measured again.

    Raises:
        DeviceFaultError: no surface between top and bottom, or contradictory measurements.
    """
    felt_elsewhere = _elsewhere(felt, at, settings.surface.tilt)
    yield from _search_again(settings, safe_z_mm, at, felt_elsewhere, found)
    heights = [line.touch_mm for line in found[1:]]
    low, high = min(heights), max(heights)
    if high - low > settings.surface.spread_mm:
        raise DeviceFaultError(
            f'the surface was found between {low:.3f} and {high:.3f} mm at x {at[0]:g}, y {at[1]:g} mm from the centre '
            'of the gel; is the tip loose, or the force/torque sensor too noisy?'
        )
    return Corner(*at, float(np.median(heights)), found[1:])


def surface_through(felt: Sequence[Corner], settings: CollectionSettings) -> Surface:
    """The plane through all corners, with the softest of their loading lines.

    Raises:
        DeviceFaultError: contradictory measurements.
    """
    lines = [line for corner in felt for line in corner.lines]
    places = [corner[:3] for corner in felt]
    return replace(plane(places, settings), softest=softest(lines, settings.limits.least_share))


def _elsewhere(felt: Sequence[Corner], at: tuple[float, float], tilt: float) -> Loading | None:
    """A lower bound of the force at a place: the softest line, at the lowest height that `tilt` allows."""
    if not felt:
        return None
    lowest_mm = max(corner.z_mm - tilt * math.dist(corner[:2], at) for corner in felt)
    softest_line = min((line for corner in felt for line in corner.lines), key=lambda line: line.slope)
    return softest_line._replace(touch_mm=lowest_mm)


def softest(lines: Sequence[Loading], least_share: float) -> Loading:
    """The loading line with the smallest force.

    Raises:
        DeviceFaultError: less than `least_share` of the force of the stiffest at the same depth.
    """
    soft, stiff = (least(lines, key=lambda line: line.slope) for least in (min, max))
    if soft.force_n(1.0) < least_share * stiff.force_n(1.0):
        raise DeviceFaultError(
            f'in the surface search the gel gave {soft.force_n(1.0):.2f} N at 1 mm once, and '
            f'{stiff.force_n(1.0):.2f} N another time: is the sensor correct? '
            'If the gel really differs, lower limits.least_share'
        )
    return soft


def plane(places: Sequence[tuple[float, float, float]], settings: CollectionSettings) -> Surface:
    """The least-squares plane through the places (x, y, height).

    Raises:
        DeviceFaultError: it is too steep, or too far from one of them.
    """
    table = np.array([(1.0, x, y) for x, y, _ in places])
    heights = np.array([z for _, _, z in places])
    (z, slope_x, slope_y), *_ = np.linalg.lstsq(table, heights, rcond=None)
    error = float(np.abs(table @ np.array([z, slope_x, slope_y]) - heights).max())
    limits = settings.surface
    if error > limits.flat_mm:
        raise DeviceFaultError(f'the surface is not flat: a corner lies {error:.3f} mm off; clean tip and gel')
    if math.hypot(slope_x, slope_y) > limits.tilt:
        raise DeviceFaultError(f'the surface is tilted by {math.hypot(slope_x, slope_y):.3f} mm/mm; level the gel')
    return Surface(float(z), float(slope_x), float(slope_y))


def _search_again(
    settings: CollectionSettings,
    safe_z_mm: float,
    at: tuple[float, float],
    felt_elsewhere: Loading | None,
    found: list[Loading],
) -> Procedure[None]:
    """From the safe height and back: once with coarse steps, `repeats` times with fine ones."""
    surface, motion = settings.surface, settings.motion
    x, y = surface.gel_x_mm + at[0], surface.gel_y_mm + at[1]
    yield Go(z=safe_z_mm, feed_mm_min=motion.travel_mm_min)
    yield Go(x, y, feed_mm_min=motion.travel_mm_min)
    tare = yield from zero(settings)
    yield Go(z=surface.top_mm, feed_mm_min=motion.approach_mm_min)
    if not found:
        found.append((yield from _search(settings, tare, surface.top_mm, surface.step_mm, felt_elsewhere)))
    while len(found) <= surface.repeats:
        start = min(surface.top_mm, found[0].touch_mm + BACK_OFF_STEPS * surface.fine_step_mm)
        yield Go(z=start, feed_mm_min=motion.press_mm_min)
        found.append((yield from _search(settings, tare, start, surface.fine_step_mm, found[0])))
    yield Go(z=safe_z_mm, feed_mm_min=motion.approach_mm_min)


def _search(
    settings: CollectionSettings, tare: Tare, start_mm: float, step_mm: float, felt_elsewhere: Loading | None = None
) -> Procedure[Loading]:
    """From `start_mm` down to contact and some steps further; returns the loading line.

    If the loading line there is already `felt_elsewhere`, a force that stays too small ends the search.
    """
    surface = settings.surface
    loading: list[tuple[float, float]] = []
    for step in range(1, 100_000):
        z = round(start_mm - step * step_mm, 3)
        if z < surface.bottom_mm:
            break
        yield Go(z=z, feed_mm_min=surface.feed_mm_min)
        observation = yield from _felt(surface.dwell_s)
        force = float(pressing_n(wrenches(observation.samples), tare, settings.mounting).mean())
        if math.isnan(force):
            raise DeviceFaultError('the sensor measures no force along z, so it cannot find the surface; set its axes')
        noise = tare.noise_n / math.sqrt(len(observation.samples))
        if felt_elsewhere is None and force < -(5 * noise + settings.press.unloaded_n):  # later a sticky gel may pull
            raise DeviceFaultError(
                f'the force points up, {-force:.2f} N at z {z:.2f} mm, as if the tip were pulled: set '
                'mounting.upside_down as the sensor is mounted, or the sign of its scale'
            )
        if felt_elsewhere is not None:
            _require_rise(felt_elsewhere, settings, z, force + 5 * noise)
        if loading or force > 5 * noise + surface.least_n:
            loading.append((observation.place_mm[2], force))
        if len(loading) > surface.beyond:
            return loading_line(loading, FLAT if 'flat' in settings.press.indenter.lower() else HERTZ)
    raise DeviceFaultError(
        f'the tip met no surface between {surface.top_mm:g} and {surface.bottom_mm:g} mm; '
        'set surface.top_mm and surface.bottom_mm to heights above and below the gel, and check the sensor'
    )


def _require_rise(felt_elsewhere: Loading, settings: CollectionSettings, z_mm: float, most_n: float) -> None:
    """Raise DeviceFaultError if the force is less than `least_share` of the earlier force at this place."""
    gave_n = felt_elsewhere.force_n(felt_elsewhere.touch_mm - settings.surface.flat_mm - z_mm)
    if most_n + settings.surface.least_n < settings.limits.least_share * gave_n:
        raise DeviceFaultError(
            f'the force is at most {most_n:.2f} N at z {z_mm:.2f} mm, but the gel gave {gave_n:.2f} N just before: '
            'is the sensor correct, does z move?'
        )


def _felt(dwell_s: float) -> Procedure[Observation]:
    """Wait for some samples; the safety decides how long a sensor may be silent."""
    observation = yield Look(dwell_s)
    start_ns = observation.since_ns
    while len(observation.samples) < FEWEST:
        observation = yield Look(dwell_s, start_ns)
    return observation


def loading_line(loading: Sequence[tuple[float, float]], power: float = HERTZ) -> Loading:
    """The line through F^power over height, and the height at which it reaches 0.

    A sphere with F = d^1.5 at depth d, contact at 0: (-0.1, 0.0316), (-0.2, 0.0894) give 0 and 1.

    Raises:
        DeviceFaultError: the force does not grow with depth.
    """
    heights = np.array([z for z, _ in loading])
    roots = np.array([max(force, 0.0) ** power for _, force in loading])
    slope, offset = np.polyfit(heights, roots, 1)
    if slope >= 0:
        raise DeviceFaultError('the force does not grow while the tip goes down; does the tip move?')
    return Loading(float(-offset / slope), float(-slope), power)
