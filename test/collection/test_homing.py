"""What goes wrong while the machine homes."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import Run

from tactile_nodes.errors import DeviceFaultError


def test_sensor_that_falls_silent_while_homing_is_named_as_the_reason(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.rig.silent_sensor = True
    with pytest.raises(DeviceFaultError, match='force/torque sensor has been silent'):
        run.campaign.run()
