"""Set up wrongly: a longer tip, and none of the heights set anew; a sensor that is mounted the other way up."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from rehearsing import SAFE_Z_MM, WORLD, Run, changed

from tactile_nodes.errors import DeviceFaultError


@pytest.mark.parametrize('deep_mm', [0.4, 1.0])
def test_a_tip_that_touches_at_the_safe_height_is_not_moved_sideways(tmp_path: Path, deep_mm: float) -> None:
    """Its force there, 0.1 or 0.4 N, is far from the limit of 3 N, and would become the zero."""
    run = Run(tmp_path, world=dataclasses.replace(WORLD, gel_z_mm=SAFE_Z_MM + deep_mm))
    touched: set[tuple[float, float]] = set()

    def look() -> None:
        now_ns = run.rig.clock.now_ns()
        if run.world.press_at(now_ns).depth_mm > 0:
            x_mm, y_mm, _ = run.world.tip_at(now_ns)
            touched.add((round(x_mm, 3), round(y_mm, 3)))

    run.rig.clock.every(0.02, look)
    with pytest.raises(DeviceFaultError, match=r'the force changes by 0\.\d+ N .* the safe height of -8 mm'):
        run.campaign.run()
    assert len(touched) == 1
    assert run.world.press_at(run.rig.clock.now_ns()).depth_mm <= 0


def test_a_sensor_that_is_set_up_the_wrong_way_up_ends_the_probe_at_the_touch(tmp_path: Path) -> None:
    """Its force on the gel is negative; the probe would go down to surface.bottom_mm, 1.5 mm into the gel."""
    run, deepest_mm = Run(tmp_path, changed(mounting={'upside_down': True})), [0.0]

    def look() -> None:
        deepest_mm.append(run.world.press_at(run.rig.clock.now_ns()).depth_mm)

    run.rig.clock.every(0.02, look)
    with pytest.raises(DeviceFaultError, match=r'the force points up, .* set mounting\.upside_down'):
        run.campaign.run()
    assert max(deepest_mm) < 0.5
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
