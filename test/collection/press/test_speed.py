"""A feed is refused when the tip could not be stopped in time."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import cast

import pytest

from tactile_nodes.collection.press.speed import check_speeds, greatest_feed, stopping_mm
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings, MotionSettings
from tactile_nodes.drivers.cnc.contract import Cnc
from tactile_nodes.errors import ConfigurationError

SETTINGS = CollectionSettings()


def with_approach(feed_mm_min: float) -> CollectionSettings:
    return dataclasses.replace(SETTINGS, motion=MotionSettings(approach_mm_min=feed_mm_min))


def machine(deceleration_mm_s2: float = 200.0, blind_step_mm: float | None = None) -> Cnc:
    return cast('Cnc', SimpleNamespace(deceleration_mm_s2=deceleration_mm_s2, blind_step_mm=blind_step_mm))


def test_way_to_rest_is_that_of_the_delay_and_of_braking() -> None:
    # 5 mm/s for 75 ms are 0.375 mm, and 25 / 400 = 0.0625 mm to brake at 200 mm/s².
    assert stopping_mm(SETTINGS, 300.0, 200.0) == pytest.approx(0.4375)


def test_usual_feeds_can_be_stopped() -> None:
    check_speeds(SETTINGS, machine(), 0.001)


def test_greatest_feed_is_allowed_and_a_faster_one_is_not() -> None:
    feed = greatest_feed(SETTINGS, 200.0)
    # 2 N that may be added at 2 N/mm are 1 mm: 10 mm/s for 75 ms are 0.75 mm, and 100 / 400 = 0.25 mm to brake.
    assert feed == pytest.approx(600.0)
    check_speeds(with_approach(0.999 * feed), machine())
    with pytest.raises(ConfigurationError):
        check_speeds(with_approach(1.001 * feed), machine())


def test_refusal_names_the_numbers_and_what_is_allowed() -> None:
    with pytest.raises(ConfigurationError) as caught:
        check_speeds(with_approach(1200.0), machine(), 0.01)
    # 20 mm/s for 85 ms are 1.7 mm, 400 / 400 = 1 mm to brake; 2.7 mm at 2 N/mm are 5.4 N on top of 3 N.
    for words in (
        'motion.approach_mm_min',
        '2.70 mm',
        '75 ms',
        '10 ms',
        '200 mm/s²',
        '8.40 N',
        'bearable_n 5',
        'at most',
    ):
        assert words in str(caught.value)


def test_slow_sensor_asks_for_a_slower_approach() -> None:
    check_speeds(SETTINGS, machine(), 0.1)
    with pytest.raises(ConfigurationError):
        check_speeds(with_approach(400.0), machine(), 0.1)  # 6.67 mm/s for 175 ms are 1.17 mm


def test_a_machine_that_stops_slowly_asks_for_a_slower_approach() -> None:
    """Grbl's own default of $122: at 5 mm/s it needs 25 / 20 = 1.25 mm to brake, and 0.375 mm until it begins to."""
    with pytest.raises(ConfigurationError, match=r'travels 1\.62 mm on .* 10 mm/s².*at most 227 mm/min'):
        check_speeds(SETTINGS, machine(deceleration_mm_s2=10.0))


def test_rigid_contact_allows_hardly_any_speed() -> None:
    stiff = dataclasses.replace(SETTINGS, limits=LimitSettings(stiffness_n_mm=100.0))
    with pytest.raises(ConfigurationError):
        check_speeds(stiff, machine())
    assert greatest_feed(stiff, 200.0) < 20.0


def test_machine_that_steps_blindly_goes_no_farther_than_a_step() -> None:
    check_speeds(with_approach(1200.0), machine(blind_step_mm=0.05))


def test_limit_that_leaves_nothing_to_stop_in_is_refused() -> None:
    with pytest.raises(ConfigurationError, match='bearable_n'):
        check_speeds(dataclasses.replace(SETTINGS, limits=LimitSettings(force_n=6.0)), machine())
