"""What goes wrong while the machine homes."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import SETTINGS, Run, changed

from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError


def test_sensor_that_falls_silent_while_homing_is_named_as_the_reason(tmp_path: Path) -> None:
    run = Run(tmp_path)
    begins_s = SETTINGS.limits.steady_again_s
    run.after(begins_s + 0.5, lambda: setattr(run.rig, 'silent_sensor', True))
    with pytest.raises(DeviceFaultError, match='force/torque sensor has been silent'):
        run.campaign.run()


def test_nothing_moves_before_sensor_and_camera_are_well(tmp_path: Path) -> None:
    run = Run(tmp_path, changed(limits={'recover_s': 3.0}))
    run.rig.silent_sensor = True
    height_mm = run.height_mm
    with pytest.raises(DeviceTimeoutError, match='not well'):
        run.campaign.run()
    assert run.height_mm == height_mm
