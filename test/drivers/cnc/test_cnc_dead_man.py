"""A process that commanded a machine and is gone: the tip goes up, by a program that outlives it."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from cnc_rigs import device_of, pty_rig, settings_of
from coarse_table import coarse_table

from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.drivers.serial_port import open_port
from tactile_nodes.emulators.serial_ports import PtyPort
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import DeviceBusyError

HOLDER = """
import os, signal, sys
from tactile_nodes.drivers.cnc.dead_man import DeadMan
held = DeadMan(int(sys.argv[1]), [(0.0, b'up'), (0.05, b' and up')])
if sys.argv[2] == 'stopped':
    held._process.send_signal(signal.SIGSTOP)
if sys.argv[2] == 'killed':
    os.kill(os.getpid(), signal.SIGKILL)
held.dismiss()
"""
COMMANDER = """
import sys
sys.path[:0] = sys.argv[1].split(':')
from cnc_rigs import settings_of
from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.cnc import grbl_hearing, marlin_dialogue
from tactile_nodes.drivers.cnc.opening import open_cnc
grbl_hearing.SILENT_S = marlin_dialogue.SILENT_S = 10.0  # the emulated controller may have to wait for a processor
cnc = open_cnc(settings_of(sys.argv[2], source=sys.argv[3], retract_mm_min=2000.0), SystemClock())
cnc.home()
cnc.move(z=float(sys.argv[4]), feed=2000.0)
cnc.wait_idle()
print('low', flush=True)
sys.stdin.read()
"""


def received(master: int, patience_s: float) -> bytes:
    found, deadline_s = b'', monotonic_s() + patience_s
    while monotonic_s() < deadline_s and found != b'up and up':
        if select.select([master], [], [], 0.05)[0]:
            found += os.read(master, 100)
    return found


@pytest.mark.parametrize(
    ('ending', 'farewell', 'patience_s'),
    [('killed', b'up and up', 60.0), ('farewell', b'', 0.5), ('stopped', b'', 0.5)],
)
def test_what_was_agreed_is_sent_after_a_kill_and_after_a_farewell_nothing(
    ending: str, farewell: bytes, patience_s: float
) -> None:
    master, slave = os.openpty()
    try:
        subprocess.run([sys.executable, '-c', HOLDER, str(slave), ending], pass_fds=(slave,), check=False, timeout=120)
        assert received(master, patience_s) == farewell
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(('kind', 'low_mm'), [('grbl', -10.0), ('marlin', 50.0)])
def test_a_killed_commander_leaves_the_tip_at_the_safe_height(kind: str, low_mm: float, tmp_path: Path) -> None:
    start_mm = (-119.0, -119.0, -1.0) if kind == 'marlin' else (-1.0, -1.0, -1.0)
    clock, world = SystemClock(), World(WorldSettings(start_mm=start_mm), table=coarse_table())
    zero_mm = 60.0 if kind == 'marlin' else 0.0
    with PtyPort(device_of(kind, world, clock), clock, tmp_path / 'ttyTEST', reset_on_open=True) as port:
        beside = Path(__file__).parent, Path(__file__).parents[2]
        words = [':'.join(map(str, beside)), kind, str(port.path), str(low_mm)]
        with subprocess.Popen(
            [sys.executable, '-c', COMMANDER, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as commander:
            assert commander.stdout is not None
            assert commander.stdout.readline() == 'low\n'
            assert world.tip_at(clock.now_ns())[2] + zero_mm == pytest.approx(low_mm, abs=0.01)
            commander.send_signal(signal.SIGKILL)
        deadline_s = monotonic_s() + 60.0
        safe_mm = settings_of(kind).safe_z_mm
        while monotonic_s() < deadline_s and world.tip_at(clock.now_ns())[2] + zero_mm < safe_mm - 0.01:
            clock.sleep_until(clock.now_ns() + 20_000_000)
        assert world.tip_at(clock.now_ns())[2] + zero_mm == pytest.approx(safe_mm, abs=0.01)
        if kind == 'marlin':  # a Grbl's is held for as long as its longest way up might take
            require_let_go(port.path, deadline_s)


def require_let_go(port: Path, deadline_s: float) -> None:
    """The port is held until all has been said."""
    clock, opened = SystemClock(), None
    while opened is None and monotonic_s() < deadline_s:
        with contextlib.suppress(DeviceBusyError):
            opened = open_port(str(port), 115200, 'untouched', clock)
        clock.sleep_until(clock.now_ns() + 20_000_000)
    assert opened is not None
    opened.close()


def test_after_a_restart_nobody_sends_the_tip_to_a_height_that_is_up_no_more(tmp_path: Path) -> None:
    """A controller that has restarted is at 0 by its own word: its safe height would be 5 mm deeper."""
    with pty_rig('grbl', tmp_path) as rig:
        rig.cnc.home()
        watch = rig.cnc._dead_man
        rig.device.power_cycle()
        deadline_s = monotonic_s() + 60.0
        while rig.cnc.status().homed and monotonic_s() < deadline_s:
            rig.clock.sleep_until(rig.clock.now_ns() + 20_000_000)
        assert not rig.cnc.status().homed
        assert watch._process.wait(60.0) == -signal.SIGKILL
        rig.cnc.home()
        assert rig.cnc._dead_man is not watch
        assert rig.cnc._dead_man.on_watch
