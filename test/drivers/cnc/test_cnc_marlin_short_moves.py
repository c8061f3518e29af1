"""Moves of under 6 steps, which a Marlin drops."""

from __future__ import annotations

import pytest
from cnc_rigs import homed_rig

from tactile_nodes.errors import ConfigurationError


def test_a_jog_that_marlin_would_drop_is_refused() -> None:
    """0.05 mm are 4 steps of x at 80 steps/mm, and 20 of z at 400: a Marlin 2.1 does nothing with fewer than 6."""
    rig = homed_rig('marlin without parser')
    with pytest.raises(
        ConfigurationError, match=r'would silently drop a jog of 4 steps, .* build its firmware with EMERGENCY_PARSER'
    ):
        rig.cnc.jog(dx=0.05, feed=60.0)
    before = rig.tip[2]
    rig.cnc.jog(dz=-0.05, feed=60.0)
    rig.cnc.wait_idle()
    assert rig.tip[2] == pytest.approx(before - 0.05)


def test_a_jog_that_is_too_short_for_marlin_and_for_an_error_is_left_out() -> None:
    """0.0125 mm are 5 steps of z: no more than the 0.02 mm at which a place counts as reached. 0.015 mm are 6."""
    rig = homed_rig('marlin without parser')
    before = rig.tip
    for _ in range(3):
        rig.cnc.jog(dz=-0.0125, feed=60.0)
        rig.cnc.wait_idle()
    assert rig.tip == before == pytest.approx(rig.cnc.status().position_mm)
    rig.cnc.jog(dz=-0.015, feed=60.0)
    rig.cnc.wait_idle()
    assert rig.tip[2] == pytest.approx(before[2] - 0.015)


def test_a_move_that_marlin_drops_leaves_the_tip_where_it_is_known_to_be() -> None:
    """As 2.1.2 with M114_REALTIME did: after a stop it was 0.05 mm, 4 steps of x, from where it was sent."""
    rig = homed_rig('marlin realtime')
    here = rig.cnc.status().position_mm
    rig.cnc.move(x=here[0] + 0.05, feed=600.0)
    rig.cnc.wait_idle()
    assert rig.cnc.status().position_mm == here == pytest.approx(rig.tip)
    rig.cnc.move(x=here[0] + 0.1, feed=600.0)
    rig.cnc.wait_idle()
    assert rig.cnc.status().position_mm[0] == pytest.approx(here[0] + 0.1)
    assert rig.sent().count(b'M503') == 1


def test_a_dropped_move_that_a_rounded_report_makes_look_longer_is_known_too() -> None:
    """0.066 mm are 5.3 steps of x. From a place that is reported as 20.43 mm they look like 5.6."""
    rig = homed_rig('marlin realtime')
    rig.cnc.move(x=20.426, feed=600.0)
    rig.cnc.wait_idle()
    rig.cnc.move(x=20.36, feed=600.0)
    rig.cnc.wait_idle()
    assert rig.tip[0] == pytest.approx(20.426)
