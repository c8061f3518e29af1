"""A Marlin that is stopped while it homes, as 2.1.2.1 behaved."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from cnc_rigs import Rig, direct_rig

from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceFaultError


def home_until(rig: Rig, moment: Callable[[], bool]) -> None:
    """Home, and stop at a moment. The guard's thread does so; here, whatever waits for the end of homing does."""
    link = rig.cnc._talk().link
    wait, stopped = link.wait, []

    def stop_once(done: Callable[[], bool], timeout_s: float) -> bool:
        if b'G28' in rig.sent() and not stopped:
            stopped.append(True)
            while not moment():
                wait(lambda: False, 0.02)
            with pytest.raises(DeviceFaultError, match=r'halted itself \(Error:Printer halted'):
                rig.cnc.stop()
        return wait(done, timeout_s)

    link.wait = stop_once
    with pytest.raises(DeviceFaultError, match="'G28' was aborted by a stop"):
        rig.cnc.home()


def test_a_stop_on_its_way_to_a_switch_halts_it_and_that_is_told() -> None:
    rig = direct_rig('marlin')
    rig.cnc.connect()
    x_mm = rig.tip[0]
    home_until(rig, lambda: rig.tip[0] < x_mm - 1.0)
    assert b'echo:Homing Failed' in rig.received()
    assert rig.cnc.health.level == Level.ERROR
    with pytest.raises(DeviceFaultError, match='switch it off and on, check it, and connect again'):
        rig.cnc.home()


def test_a_stop_on_its_way_off_a_switch_ends_homing_too() -> None:
    """One M410 ends only the 5 mm off the switch of z; x and y would still go to theirs, at -120 mm."""
    rig = direct_rig('marlin')
    rig.cnc.connect()
    x, y, _ = rig.tip
    top_mm = rig.at(0.0, 0.0, 0.0)[2]
    highest_mm = [rig.tip[2]]

    def backs_off() -> bool:
        highest_mm.append(max(highest_mm[-1], rig.tip[2]))
        return highest_mm[-1] > top_mm - 0.5 and rig.tip[2] < top_mm - 1.0

    home_until(rig, backs_off)
    assert rig.tip[:2] == pytest.approx((x, y), abs=0.01)


def test_a_stop_of_a_motion_is_sent_once() -> None:
    rig = direct_rig('marlin')
    rig.cnc.connect()
    rig.cnc.home()
    rig.cnc.move(x=rig.at(-10, 0, 0)[0], feed=600.0)
    rig.cnc._talk().link.wait(lambda: False, 1.0)
    rig.cnc.stop()
    assert rig.sent().count(b'M410') == 1
