"""What goes wrong while the machine homes."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import SETTINGS, Run, changed

from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError


@pytest.mark.parametrize('part', ['silent_sensor', 'silent_camera'])
def test_homing_begins_again_when_what_fell_silent_meanwhile_is_well(tmp_path: Path, part: str) -> None:
    run = Run(tmp_path)
    begins_s = SETTINGS.limits.steady_again_s
    run.after(begins_s + 0.5, lambda: setattr(run.rig, part, True))
    run.after(begins_s + 2.5, lambda: setattr(run.rig, part, False))
    run.campaign.run()
    assert [text for text in run.said if 'homing again' in text]
    assert sorted(run.recorded) == list(range(1, 13))


def test_machine_that_is_locked_because_its_homing_was_broken_off_homes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(tmp_path)
    machine = run.rig.cnc
    home, broken = machine.home, []

    def home_once_broken_off() -> None:
        """As Grbl, which is locked by alarm 6 then until it homes."""
        if not broken:
            broken.append(True)
            run.rig.silent_sensor = True
            run.after(1.0, lambda: setattr(run.rig, 'silent_sensor', False))
            run.rig.clock.sleep_until(run.rig.clock.now_ns() + 500_000_000)
            monkeypatch.setattr(type(machine), 'health', property(lambda _: Health(Level.ERROR, 'locked by alarm 6')))
            raise DeviceFaultError('locked by alarm 6, a reset while it homed')
        monkeypatch.setattr(type(machine), 'health', property(lambda _: Health(Level.OK, 'idle')))
        home()

    machine.home = home_once_broken_off  # type: ignore[method-assign]
    run.campaign.run()
    assert sorted(run.recorded) == list(range(1, 13))


def test_sensor_that_falls_silent_while_homing_for_good_is_named_as_the_reason(tmp_path: Path) -> None:
    run = Run(tmp_path)
    begins_s = SETTINGS.limits.steady_again_s
    run.after(begins_s + 0.5, lambda: setattr(run.rig, 'silent_sensor', True))
    with pytest.raises(DeviceTimeoutError, match=r'force/torque sensor has been silent .* did not recover'):
        run.campaign.run()


def test_nothing_moves_before_sensor_and_camera_are_well(tmp_path: Path) -> None:
    run = Run(tmp_path, changed(limits={'recover_s': 3.0}))
    run.rig.silent_sensor = True
    height_mm = run.height_mm
    with pytest.raises(DeviceTimeoutError, match='do not work properly'):
        run.campaign.run()
    assert run.height_mm == height_mm
