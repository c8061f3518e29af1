"""How fast the tip may go down, so that the force is still bearable if the stop starts after the limit was exceeded.

At speed v, a force that rises by k per millimetre exceeds the limit by k (v t + v² / 2a) until the tip is at rest,
with the reaction time t and the deceleration a.
"""

from __future__ import annotations

import math

from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.contract import Cnc
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSensor
from tactile_nodes.errors import ConfigurationError

S_PER_MIN = 60.0
MS_PER_S = 1000.0


def check_speeds(settings: CollectionSettings, cnc: Cnc, period_s: float = 0.0) -> None:
    """Refuse feeds that cannot be stopped in time; `period_s` is the sample period of the force sensor.

    A machine that moves in steps of `Cnc.blind_step_mm` and waits after each goes at most that far after a stop.

    Raises:
        ConfigurationError: names the feed, the numbers, and the allowed feed.
    """
    limits, brake_mm_s2 = settings.limits, cnc.deceleration_mm_s2
    spare_n = limits.bearable_n - limits.force_n
    if spare_n <= 0:
        raise ConfigurationError(
            f'limits.bearable_n, {limits.bearable_n:g} N, must be above limits.force_n, {limits.force_n:g} N, '
            'because the tip travels on while it stops'
        )
    feeds = {
        'motion.approach_mm_min': settings.motion.approach_mm_min,
        'motion.press_mm_min': settings.motion.press_mm_min,
        'surface.feed_mm_min': settings.surface.feed_mm_min,
    }
    for name, feed in feeds.items():
        way_mm = min(stopping_mm(settings, feed, brake_mm_s2, period_s), cnc.blind_step_mm or math.inf)
        rise_n = limits.stiffness_n_mm * way_mm
        if rise_n > spare_n:
            raise ConfigurationError(
                f'{name} of {feed:g} is too fast: the tip travels {way_mm:.2f} mm on until it is at rest (stop after '
                f'{limits.stop_ms:g} ms and a sample of {MS_PER_S * period_s:g} ms, {brake_mm_s2:g} mm/s²), '
                f'which at limits.stiffness_n_mm {limits.stiffness_n_mm:g} raises the force from limits.force_n to '
                f'{limits.force_n + rise_n:.2f} N, more than limits.bearable_n {limits.bearable_n:g}; '
                f'use at most {greatest_feed(settings, brake_mm_s2, period_s):.0f} mm/min'
            )


def longest_period_s(sensor: ForceTorqueSensor) -> float:
    """Time between two samples, as expected or as observed; also of a sensor that is lost now. 0: unknown."""
    return max((1 / hz for hz in (sensor.rate_hz, sensor.expected_hz) if hz > 0), default=0.0)


def stopping_mm(settings: CollectionSettings, feed_mm_min: float, brake_mm_s2: float, period_s: float = 0.0) -> float:
    """The distance from a force above the limit to rest: 300 mm/min, 75 ms and 200 mm/s² give 0.4375 mm."""
    speed = feed_mm_min / S_PER_MIN
    return speed * _late_s(settings, period_s) + speed**2 / (2 * brake_mm_s2)


def greatest_feed(settings: CollectionSettings, brake_mm_s2: float, period_s: float = 0.0) -> float:
    """The feed in mm/min whose stopping distance gives exactly the bearable force."""
    limits, late_s = settings.limits, _late_s(settings, period_s)
    way_mm = (limits.bearable_n - limits.force_n) / limits.stiffness_n_mm
    speed = brake_mm_s2 * (math.sqrt(late_s**2 + 2 * way_mm / brake_mm_s2) - late_s)
    return S_PER_MIN * speed


def _late_s(settings: CollectionSettings, period_s: float) -> float:
    return settings.limits.stop_ms / MS_PER_S + period_s
