"""What goes wrong while the machine homes."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import ALL, SETTINGS, Run, changed

from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError


@pytest.mark.parametrize('part', ['silent_sensor', 'silent_camera'])
def test_homing_begins_again_when_what_fell_silent_meanwhile_is_well(tmp_path: Path, part: str) -> None:
    run = Run(tmp_path)
    begins_s = SETTINGS.limits.steady_again_s
    run.after(begins_s + 0.5, lambda: setattr(run.rig, part, True))
    run.after(begins_s + 2.5, lambda: setattr(run.rig, part, False))
    run.campaign.run()
    assert [text for text in run.printed if 'homing again' in text]
    assert sorted(run.recorded) == ALL


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
    assert sorted(run.recorded) == ALL


def test_sensor_that_falls_silent_while_homing_for_good_is_named_as_the_reason(tmp_path: Path) -> None:
    run = Run(tmp_path)
    begins_s = SETTINGS.limits.steady_again_s
    run.after(begins_s + 0.5, lambda: setattr(run.rig, 'silent_sensor', True))
    with pytest.raises(DeviceTimeoutError, match=r'sensor has been silent .* did not recover .*no samples'):
        run.campaign.run()


@pytest.mark.parametrize(
    ('parts', 'reason'),
    [
        (['silent_sensor'], 'the force/torque sensor sends no samples; it'),
        (['silent_camera'], 'the camera sends no images; it'),
        (['silent_camera', 'silent_sensor'], 'the camera sends no images; the force/torque sensor'),
    ],
)
def test_nothing_moves_before_sensor_and_camera_are_well(tmp_path: Path, parts: list[str], reason: str) -> None:
    run = Run(tmp_path, changed(limits={'recover_s': 3.0}))
    for part in parts:
        setattr(run.rig, part, True)
    height_mm = run.height_mm
    with pytest.raises(DeviceTimeoutError, match=f'^{reason}'):
        run.campaign.run()
    assert run.height_mm == height_mm
    assert not any('tip' in line for line in run.printed)


@pytest.mark.parametrize('begins', [False, True], ids=['before it homes', 'while it homes'])
def test_run_that_is_stopped_before_its_tip_went_down_ends_well(tmp_path: Path, begins: bool) -> None:
    run = Run(tmp_path)

    def stop() -> None:
        run.rig.hands.asked_to_stop = True
        if run.rig.hands.homing:
            run.rig.cnc.stop()

    run.after(SETTINGS.limits.steady_again_s + (0.5 if begins else -0.5), stop)
    assert 'stopped on request' in run.campaign.run()
    assert ('homing' in run.printed) == begins
