"""A force that nothing bears while the run waits, with its tip up, for a device that is silent."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsing import SAFE_Z_MM, SETTINGS, Run, changed

from tactile_nodes.drivers.cnc.simulated import SimulatedCnc
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceFaultError

SILENT = Health(Level.ERROR, 'it is silent while it moves', silent=True)


@pytest.mark.parametrize('device', ['sensor', 'machine'])
def test_a_force_that_the_sensor_shows_when_it_is_back_halts_the_run(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sensor is back after 5 s, and somebody leans on the tool for half a second."""
    run, heights = Run(tmp_path), []
    health = [Health(Level.OK, 'idle')]
    monkeypatch.setattr(SimulatedCnc, 'health', property(lambda _: health[-1]))

    def begin() -> None:
        if device == 'machine':
            health.append(SILENT)
            run.after(0.5, health.pop)
        run.rig.silent_sensor = device == 'sensor'
        run.after(1.5 if device == 'machine' else 5.0, come_back)

    def come_back() -> None:
        run.rig.silent_sensor = False
        run.push(0.5)
        run.after(20.0, lambda: heights.append(run.height_mm) or run.person.acknowledge())

    run.at(3, run.in_the_gel(begin))
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert run.machine_steps == ['begun', 'halted', 'acknowledged', 'ended']
    assert heights == [pytest.approx(SAFE_Z_MM, abs=0.01)]
    assert sum(' N, more than the bearable 5 N; check' in said for said in run.printed) == 1


def test_who_answers_while_the_force_lasts_is_asked_again(tmp_path: Path) -> None:
    run = Run(tmp_path)

    def come_back() -> None:
        run.rig.silent_sensor = False
        run.push(30.0)
        for after_s in (10.0, 50.0):
            run.after(after_s, run.person.acknowledge)

    def begin() -> None:
        run.rig.silent_sensor = True
        run.after(5.0, come_back)

    run.at(3, run.in_the_gel(begin))
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert run.machine_steps == ['begun', 'halted', 'acknowledged', 'halted', 'acknowledged', 'ended']


def test_a_force_before_anything_moves_halts_the_machine(tmp_path: Path) -> None:
    run = Run(tmp_path, changed())
    start = run.world.motor_at(run.rig.clock.now_ns())
    run.after(SETTINGS.limits.steady_again_s / 2, lambda: run.push(0.1))
    with pytest.raises(DeviceFaultError, match='more than the bearable 5 N'):
        run.campaign.run()
    assert run.world.motor_at(run.rig.clock.now_ns()) == start
    assert run.machine_steps == ['halted']
