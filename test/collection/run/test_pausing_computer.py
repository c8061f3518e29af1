"""A computer that has other work: devices are silent now and then, and a run goes on or says why it cannot."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rehearsing import ALL, SAFE_Z_MM, SETTINGS, Dots, Run, changed

from tactile_nodes.bus.node import priority
from tactile_nodes.collection.press.rest import await_recovery
from tactile_nodes.drivers.cnc.simulated import SimulatedCnc
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

SILENT = Health(Level.ERROR, 'it is silent while it moves', silent=True)


@pytest.fixture
def healths(monkeypatch: pytest.MonkeyPatch) -> list[Health]:
    """What the machine says of itself: the last of them."""
    reports = [Health(Level.OK, 'idle')]
    monkeypatch.setattr(SimulatedCnc, 'health', property(lambda _: reports[-1]))
    return reports


def fall_silent(run: Run, healths: list[Health], seconds: float = 0.5) -> None:
    healths.append(SILENT)
    run.after(seconds, healths.pop)


def silences(run: Run, seconds: float, lasting_s: float = 0.2) -> None:
    """The sensor is silent every so many seconds."""

    def begin() -> None:
        run.rig.silent_sensor = True
        run.after(lasting_s, lambda: setattr(run.rig, 'silent_sensor', False))

    run.rig.clock.every(seconds, begin)


def test_a_machine_that_was_silent_is_stopped_brought_up_checked_and_pressed_with_again(
    tmp_path: Path, healths: list[Health]
) -> None:
    run = Run(tmp_path, changed(anchor={'every': 50}), dots=Dots())
    run.at(3, run.in_the_gel(lambda: fall_silent(run, healths)))
    ended = run.campaign.run()
    assert ended.startswith('the plan is done: 8 of 8 presses recorded')
    assert [record.reason for record in run.published if record.reason] == ['it is silent while it moves']
    silent = next(
        number for number, line in enumerate(run.printed) if 'the tip is up, waiting until it has recovered' in line
    )
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
    # The four anchors at the start; one after the silence, since steps may be lost; one at the end.
    lines = run.journal.path.read_text(encoding='ascii')
    assert lines.count('"anchored"') == 2, run.printed[silent:]


def test_a_machine_that_was_silent_is_not_believed_to_be_up_without_a_force(
    tmp_path: Path, healths: list[Health]
) -> None:
    run = Run(tmp_path)

    def fall_silent_for_good() -> None:
        fall_silent(run, healths)
        run.rig.silent_sensor = True

    run.at(3, run.in_the_gel(fall_silent_for_good))
    with pytest.raises(DeviceFaultError, match='unknown whether the tip is up'):
        run.campaign.run()


def test_a_force_that_comes_late_says_as_well_that_the_tip_is_up(tmp_path: Path) -> None:
    """Each sample arrives 0.3 s after it was measured: the first that was measured since is there after four looks."""
    run = Run(tmp_path)
    clock, readings = run.rig.clock, run.rig.readings
    arrived = readings.samples
    late = lambda since_ns: [each for each in arrived(since_ns) if each.stamp_ns < clock.now_ns() - 300_000_000]  # noqa: E731
    readings.samples = late  # type: ignore[method-assign,assignment]
    begin_ns = clock.now_ns()
    assert run.rig.hands.overlook(0.1) == []
    samples = run.rig.hands.overlook(0.1, 20)
    assert samples and all(sample.stamp_ns >= begin_ns + 100_000_000 for sample in samples)
    assert clock.now_ns() - begin_ns == pytest.approx(0.5e9, abs=1e7)


def test_a_machine_that_says_nothing_any_more_ends_the_run(tmp_path: Path, healths: list[Health]) -> None:
    run = Run(tmp_path)
    run.at(3, run.in_the_gel(lambda: healths.append(SILENT)))
    with pytest.raises(DeviceTimeoutError, match='did not recover within 30 s'):
        run.campaign.run()
    assert run.rig.safety.fell_silent
    assert run.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)


def test_a_machine_that_falls_silent_on_the_way_up_is_led_on(
    tmp_path: Path, healths: list[Health], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(tmp_path)
    retract, tries = run.rig.cnc.retract, []

    def broken_off() -> None:
        tries.append(run.rig.clock.now_ns())
        if len(tries) > 2:
            monkeypatch.setattr(run.rig.cnc, 'retract', retract)
            healths.pop()
            return retract()
        if len(tries) == 1:
            healths.append(SILENT)
        raise DeviceFaultError('aborted, because the machine is silent while it moves')

    def break_off() -> None:
        monkeypatch.setattr(run.rig.cnc, 'retract', broken_off)
        run.rig.silent_sensor = True
        run.after(0.3, lambda: setattr(run.rig, 'silent_sensor', False))

    run.at(3, run.in_the_gel(break_off))
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    assert len(tries) == 3


def test_a_surface_is_felt_for_on_a_computer_that_pauses_every_ten_seconds(tmp_path: Path) -> None:
    """A corner takes some 15 s, all of them 50: what was found is not looked for again."""
    run = Run(tmp_path, changed(surface={'repeats': 2}))
    silences(run, seconds=10.0)
    assert run.campaign.run().startswith('the plan is done: 8 of 8')
    waited = [line for line in run.printed if 'the tip is up, waiting until it has recovered' in line]
    assert len(waited) > 5


def test_a_run_that_silences_end_is_a_matter_of_time_and_goes_on_when_begun_again(tmp_path: Path) -> None:
    first = Run(tmp_path)
    first.at(3, lambda: silences(first, seconds=2.6))
    with pytest.raises(DeviceFaultError, match=r'presses in a row were rejected|stopped: .* silent'):
        first.campaign.run()
    assert first.rig.safety.fell_silent
    assert first.height_mm == pytest.approx(SAFE_Z_MM, abs=0.01)
    first.journal.close()
    second = Run(tmp_path, unasked=False)
    assert second.campaign.run().startswith('the plan is done: 8 of 8')
    assert sorted(first.recorded + second.recorded) == ALL


def test_a_crowded_computer_is_reported_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(priority.os, 'sched_getaffinity', lambda _: {0, 1})
    monkeypatch.setattr(priority.os, 'getloadavg', lambda: (11.6, 4.0, 1.0))
    monkeypatch.setenv(priority.VARIABLE, '')
    assert re.fullmatch(
        r'this computer is overloaded \(12 programs on 2 processors\), so devices seem silent: stop some, '
        r'then start again: recorded presses are kept, and the run continues with the next press', priority.crowded()
    )  # fmt: skip
    monkeypatch.setattr(priority, 'lacking', lambda: 'this user may not')
    assert 'stop some, or allow this user to raise process priority (docs/collection.md), then' in priority.crowded()
    monkeypatch.setattr(priority.os, 'getloadavg', lambda: (2.0, 4.0, 1.0))
    assert priority.crowded() == ''


def test_a_computer_that_stands_still_while_a_device_is_waited_for_is_no_device_that_stays_lost(tmp_path: Path) -> None:
    """The sensor is silent for a second; meanwhile the computer stands still for a minute, and 30 s are allowed."""
    run = Run(tmp_path)
    clock = run.rig.clock
    run.rig.silent_sensor = True

    def stand_still() -> None:
        clock._now_ns += 60_000_000_000
        run.after(0.2, lambda: setattr(run.rig, 'silent_sensor', False))

    run.after(1.0, stand_still)
    begun_ns = clock.now_ns()
    await_recovery(run.rig.hands, SETTINGS.limits, 'the sensor was silent')
    assert 62e9 < clock.now_ns() - begun_ns < 70e9
