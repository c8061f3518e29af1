"""How fast the tip may go down: so slowly that the force is bearable when it stops only after it was too great.

At speed v, a force that rises by k with each millimetre goes on above the limit by k (v t + v² / 2a) until the tip is
at rest, with the time t from a force to the stop and the deceleration a.
"""

from __future__ import annotations

import math

from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.errors import ConfigurationError

S_PER_MIN = 60.0
MS_PER_S = 1000.0


def check_speeds(settings: CollectionSettings, period_s: float = 0.0, blind_step_mm: float | None = None) -> None:
    """Refuse feeds that cannot be stopped in time; `period_s` lies between two force samples.

    A machine that goes in steps of `blind_step_mm` and waits after each goes no farther than that after a stop.

    Raises:
        ConfigurationError: naming the feed, the numbers, and what is allowed.
    """
    limits = settings.limits
    spare_n = limits.bearable_n - limits.force_n
    if spare_n <= 0:
        raise ConfigurationError(
            f'limits.bearable_n, {limits.bearable_n:g} N, must be above limits.force_n, {limits.force_n:g} N, '
            'because the tip needs a way to stop'
        )
    feeds = {
        'motion.approach_mm_min': settings.motion.approach_mm_min,
        'motion.press_mm_min': settings.motion.press_mm_min,
        'surface.feed_mm_min': settings.surface.feed_mm_min,
    }
    for name, feed in feeds.items():
        way_mm = min(stopping_mm(settings, feed, period_s), blind_step_mm or math.inf)
        rise_n = limits.stiffness_n_mm * way_mm
        if rise_n > spare_n:
            raise ConfigurationError(
                f'{name} of {feed:g} is too fast: until the tip is at rest it goes {way_mm:.2f} mm on (stop after '
                f'{limits.stop_ms:g} ms and a sample of {MS_PER_S * period_s:g} ms, {limits.brake_mm_s2:g} mm/s²), '
                f'which at limits.stiffness_n_mm {limits.stiffness_n_mm:g} makes {limits.force_n + rise_n:.2f} N of '
                f'limits.force_n, more than limits.bearable_n {limits.bearable_n:g}; '
                f'go at most {greatest_feed(settings, period_s):.0f} mm/min'
            )


def stopping_mm(settings: CollectionSettings, feed_mm_min: float, period_s: float = 0.0) -> float:
    """The way from a force above the limit to rest: 300 mm/min, 75 ms and 200 mm/s² give 0.4375 mm."""
    speed = feed_mm_min / S_PER_MIN
    return speed * _late_s(settings, period_s) + speed**2 / (2 * settings.limits.brake_mm_s2)


def greatest_feed(settings: CollectionSettings, period_s: float = 0.0) -> float:
    """The feed in mm/min whose way to rest makes the force just bearable."""
    limits, late_s = settings.limits, _late_s(settings, period_s)
    way_mm = (limits.bearable_n - limits.force_n) / limits.stiffness_n_mm
    speed = limits.brake_mm_s2 * (math.sqrt(late_s**2 + 2 * way_mm / limits.brake_mm_s2) - late_s)
    return S_PER_MIN * speed


def _late_s(settings: CollectionSettings, period_s: float) -> float:
    return settings.limits.stop_ms / MS_PER_S + period_s
