"""On the wire: a force above its limit is followed by the stop and by nothing else."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from jumping_clock import JumpingClock
from rehearsing import TABLE, Run, changed

from benchmarks.devices import rehearsal
from benchmarks.devices.direct_port import DirectPort
from tactile_nodes.clock import Clock
from tactile_nodes.collection.actions import Go, Switch
from tactile_nodes.collection.hands import Hands, TrippedError
from tactile_nodes.collection.plan.plan import PlanSettings
from tactile_nodes.collection.readings import Readings
from tactile_nodes.collection.safety import FORCE, Safety
from tactile_nodes.collection.settings import LimitSettings, MotionSettings
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings, CncStatus, Switched
from tactile_nodes.drivers.cnc.grbl import GrblCnc
from tactile_nodes.emulators.cnc.grbl import Grbl
from tactile_nodes.emulators.cnc.grbl_dialect import GrblSettings
from tactile_nodes.emulators.world import World
from tactile_nodes.errors import DeviceFaultError

JOG_CANCEL = b'\x85'
LIMIT_N = 0.4
PLAN = PlanSettings(columns=2, rows=1, pitch_mm=4.0, depths_mm=(0.5, 1.5))
JOG_Z = re.compile(rb'\$J=G21 G90 G53 .* Z(-[0-9.]+) ')


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, bytes]]:
    """What is sent to a Grbl, and when; it takes the place of the machine without a port."""
    commands: list[tuple[int, bytes]] = []

    def traffic(way: str, stamp_ns: int, data: bytes) -> None:
        if way == '>':
            commands.append((stamp_ns, data))

    def open_grbl(settings: CncSettings, clock: Clock, machine: World) -> Cnc:
        device = Grbl(machine, clock)
        cnc = GrblCnc(settings, clock, lambda: DirectPort(device, clock), traffic, threaded=False)
        cnc.connect()
        return cnc

    monkeypatch.setattr(rehearsal, 'open_cnc', open_grbl)
    return commands


def test_stop_is_the_first_thing_sent_after_the_sample_above_the_limit(
    tmp_path: Path, sent: list[tuple[int, bytes]]
) -> None:
    run = Run(tmp_path, changed(limits={'force_n': LIMIT_N, 'attempts': 1, 'rejects_in_a_row': 20}), PLAN)
    tripped_ns: list[int] = []
    tell = run.rig.safety._on_trip
    assert tell is not None

    def note(trip: object) -> None:
        tripped_ns.append(run.rig.clock.now_ns())
        tell(trip)  # type: ignore[arg-type]

    run.rig.safety._on_trip = note
    run.campaign.run()
    deep = [record for record in run.published if record.point.depth_mm == 1.5]
    assert len(tripped_ns) == len(deep) == 2
    assert all(FORCE in record.reason for record in deep)
    for at_ns in tripped_ns:
        after = [(stamp_ns, data) for stamp_ns, data in sent if stamp_ns >= at_ns]
        assert after[0] == (at_ns, JOG_CANCEL)
        # What follows is a report that says whether it rests, and the way up: nothing goes on down.
        tip_mm = run.world.tip_at(at_ns)[2]
        up_mm = next(float(found.group(1)) for _, data in after if (found := JOG_Z.match(data)))
        assert up_mm > tip_mm + 1.0


def test_jog_that_was_sent_just_after_the_stop_is_stopped_at_once(tmp_path: Path) -> None:
    """Between check and jog the safety may find something wrong, and the guard's thread stop the machine."""
    run = Run(tmp_path, changed(limits={'attempts': 1, 'rejects_in_a_row': 20}), PLAN)
    jog, retreat, now_ns = run.rig.cnc.jog, run.rig.hands.retreat, run.rig.clock.now_ns
    speeds: list[float] = []

    def jog_late(dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, *, feed: float) -> None:
        if len(run.published) == 1 and dz < 0 and run.rig.safety.trip is None:
            run.rig.safety.fail(FORCE, 'a sample between check and jog', now_ns())
            run.rig.cnc.stop()
        jog(dx, dy, dz, feed=feed)

    def retreat_later() -> None:
        speeds.append(run.world.motor_speed_at(now_ns() + 50_000_000))
        retreat()

    run.rig.cnc.jog = jog_late  # type: ignore[method-assign]
    run.rig.hands.retreat = retreat_later  # type: ignore[method-assign]
    run.campaign.run()
    assert len(speeds) > 1
    assert speeds[0] == 0.0


def test_line_that_a_stop_sets_low_fell_within_what_is_reported(tmp_path: Path, sent: list[tuple[int, bytes]]) -> None:
    """At rest in a window a Grbl is stopped by a reset, which sets the line low long before the tip is up."""
    run = Run(tmp_path, changed(limits={'attempts': 1, 'rejects_in_a_row': 20}), PLAN)
    reported: list[Switched] = []

    def tell(switched: Switched) -> None:
        reported.append(switched)
        if switched.level and run.campaign.now is not None and len(run.published) == 2:
            run.rig.safety.fail(FORCE, 'a knock', run.rig.clock.now_ns())

    run.rig.hands._on_switch = tell
    run.campaign.run()
    edges = run.world.line_edges()
    assert [switched.level for switched in reported] == [edge.level for edge in edges]
    assert all(
        switched.earliest_ns <= edge.stamp_ns <= switched.latest_ns
        for switched, edge in zip(reported, edges, strict=True)
    )


def test_force_that_comes_with_the_last_question_of_an_action_is_the_reason(tmp_path: Path) -> None:
    """The stop aborts the question for the position (a Marlin's M114). It is no fault of the machine."""
    rig = Run(tmp_path).rig

    def status_aborted() -> CncStatus:
        rig.safety.fail(FORCE, 'a sample during the last question', rig.clock.now_ns())
        raise DeviceFaultError("'M114 R' was aborted by a stop")

    rig.cnc.status = status_aborted  # type: ignore[method-assign]
    with pytest.raises(TrippedError, match='a sample during the last question'):
        rig.hands.perform(Switch(True))
    assert not rig.hands.machine_failed


def test_on_axes_slower_than_the_feed_no_more_than_two_jogs_are_sent_ahead() -> None:
    """500 mm/min is Grbl's own default: 59 mm at 1200 mm/min would be 3 s, and are 7 s."""
    clock, world, on_its_own_mm = JumpingClock(1_700_000_000_000_000_000), World(table=TABLE), []
    device = Grbl(world, clock, GrblSettings(changes=('$110=500',)))
    cnc = GrblCnc(CncSettings('the port'), clock, lambda: DirectPort(device, clock), threaded=False)

    def look(status: CncStatus) -> None:
        soon, later = (world.motor_at(clock.now_ns() + wait_ns) for wait_ns in (520_000_000, 20_000_000_000))
        on_its_own_mm.append(math.dist(soon, later))

    cnc.connect()
    cnc.home()
    hands = Hands(cnc, clock, Safety(LimitSettings()), Readings(), MotionSettings(), look)
    hands.perform(Go(x=-60.0, feed_mm_min=1200.0))
    assert cnc.status().position_mm[0] == -60.0
    assert len(on_its_own_mm) > 20
    assert max(on_its_own_mm) < 0.1
