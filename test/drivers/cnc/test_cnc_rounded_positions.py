"""Positions are reported to steps of the motors, and by a Marlin to 0.01 mm: a way up may end a little too low."""

from __future__ import annotations

import pytest
from cnc_rigs import homed_rig

from tactile_nodes.collection.actions import Go
from tactile_nodes.collection.hands import Hands
from tactile_nodes.collection.readings import Readings
from tactile_nodes.collection.safety import Safety
from tactile_nodes.collection.settings import LimitSettings, MotionSettings
from tactile_nodes.drivers.cnc.contract import Envelope
from tactile_nodes.drivers.cnc.envelope import Guard
from tactile_nodes.errors import ConfigurationError


@pytest.mark.parametrize('kind', ['marlin', 'marlin realtime'])
def test_the_tip_may_go_sideways_after_a_way_up_from_any_height(kind: str) -> None:
    """A Marlin reports 31.487 mm as 31.49. The way up to 55 mm, 23.51 mm long, ends at 54.997 mm."""
    rig = homed_rig(kind)
    hands = Hands(rig.cnc, rig.clock, Safety(LimitSettings()), Readings(), MotionSettings())
    for thousandths in range(10):
        hands.perform(Go(z=31.48 + thousandths / 1000, feed_mm_min=1200.0))
        hands.perform(Go(z=55.0, feed_mm_min=1200.0))
        hands.perform(Go(60.0 + thousandths, feed_mm_min=1200.0))
    assert rig.tip == pytest.approx((69.0, 60.0, 55.0), abs=0.01)


@pytest.mark.parametrize(('below_mm', 'allowed'), [(0.006, True), (0.019, True), (0.03, False)])
def test_sideways_is_refused_lower_than_rounding_can_leave_the_tip(below_mm: float, allowed: bool) -> None:
    """Half a step of 80 steps/mm is 0.006 mm."""
    rules = Guard(Envelope((-100.0, -100.0, -50.0), (0.0, 0.0, 0.0)), -5.0, False, 2000.0)
    low, beside = (-60.0, -60.0, -5.0 - below_mm), (-59.0, -60.0, -5.0 - below_mm)
    if allowed:
        rules.check(low, beside, 600.0)
    else:
        with pytest.raises(ConfigurationError, match='sideways'):
            rules.check(low, beside, 600.0)
