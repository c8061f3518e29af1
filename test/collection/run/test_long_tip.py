"""Somebody has screwed in a longer tip, and has set none of the heights anew."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from rehearsing import SAFE_Z_MM, WORLD, Run

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
