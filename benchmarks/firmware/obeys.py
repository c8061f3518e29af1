"""Tests all requests of the drivers on a firmware, without any fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.firmware.descent import ABOVE_MM, TRAVEL_MM_MIN
from benchmarks.firmware.faults import FAULTS, echo
from benchmarks.firmware.line import Line
from benchmarks.firmware.press import Bench, Machine
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import NO_HARD_LIMITS, Cnc, CncSettings, CncStatus
from tactile_nodes.drivers.cnc.envelope import describe_place
from tactile_nodes.drivers.cnc.opening import open_cnc
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import TactileError

MOVES, STEP_MM, FAST_MM_MIN = 60, 0.1, 600.0
FAR_MM, SLOW_MM_MIN = 10.0, 60.0
GOING_S = 0.25
SHOWN = ('20', '21', '22', '10', '110', '112', '120', '122', '130', '132')


Beginning = Callable[[Line], None]


def obeys(machine: Machine, clock: Clock, folder: Path) -> dict[str, str]:
    """Each request and its result, up to the first error."""
    found: dict[str, str] = {}
    bench = Bench(machine, FAULTS['none'], clock, folder)
    with bench.plugged() as settings:
        try:
            cnc = open_cnc(settings, clock)
        except TactileError as error:
            return {'connect': bench.named(f'refused: {error}')}
        try:
            for name, came in _asked(cnc, machine, clock):
                found[name] = bench.named(came)
        except TactileError as error:
            found['then'] = bench.named(f'failed: {error}')
        finally:
            cnc.close()
    return {**found, **connected(machine, clock, folder)}


def connected(machine: Machine, clock: Clock, folder: Path) -> dict[str, str]:
    """Connect again, each time with something wrong; returns the results."""
    checks: dict[str, tuple[Beginning, CncSettings]] = {
        'connect, all that is sent comes back': (echo, machine.settings)
    }
    if machine.kind == 'grbl':
        accepting = replace(machine.settings, accept=(*machine.settings.accept, NO_HARD_LIMITS))
        checks |= {
            'connect, it says $21=0': (_no_hard_limits, machine.settings),
            f"connect, it says $21=0, '{NO_HARD_LIMITS}' accepted": (_no_hard_limits, accepting),
        }
    return {
        name: _greeted(replace(machine, settings=settings), begin, clock, folder)
        for name, (begin, settings) in checks.items()
    }


def _greeted(machine: Machine, begin: Beginning, clock: Clock, folder: Path) -> str:
    bench = Bench(machine, FAULTS['none'], clock, folder)
    with bench.plugged() as settings:
        begin(bench.line)
        try:
            cnc = open_cnc(settings, clock)
        except TactileError as error:
            return bench.named(f'refused: {error}')
        try:
            name = _firmware(cnc).rpartition(' ')[0]
            return f'{name}, {cnc.status().state.value}'
        except TactileError as error:
            return bench.named(f'failed: {error}')
        finally:
            cnc.close()


def _no_hard_limits(line: Line) -> None:
    line.faults.change('<', b'$21=1', b'$21=0')


def _asked(cnc: Cnc, machine: Machine, clock: Clock) -> Iterator[tuple[str, str]]:
    yield 'connect', _introduced(cnc)
    x, y, z = machine.gel_mm
    yield 'home', f'{_timed(clock, cnc.home):.1f} s, {_where(cnc.status())}'
    for way in ({'z': machine.settings.safe_z_mm}, {'x': x, 'y': y}, {'z': z + ABOVE_MM}):
        cnc.move(**way, feed=TRAVEL_MM_MIN)
        cnc.wait_idle()
    yield 'moves', _where(cnc.status())
    yield f'jog 2 mm at {SLOW_MM_MIN:g} mm/min', _jogged(cnc, clock)
    cnc.move(z=machine.settings.safe_z_mm, feed=TRAVEL_MM_MIN)
    cnc.wait_idle()
    yield f'stop a jog at {FAST_MM_MIN:g} mm/min', _stopped(cnc, clock, lambda: cnc.jog(dx=FAR_MM, feed=FAST_MM_MIN))
    yield 'stop a move', _stopped(cnc, clock, lambda: cnc.move(x=x, feed=FAST_MM_MIN))
    cnc.move(x=x, z=machine.settings.safe_z_mm, feed=TRAVEL_MM_MIN)
    cnc.wait_idle()
    yield f'{MOVES} moves of {STEP_MM:g} mm at {FAST_MM_MIN:g} mm/min', _many(cnc, clock, x)
    yield 'the digital line, on and off', _switched(cnc)
    cnc.move(z=z, feed=TRAVEL_MM_MIN)
    cnc.wait_idle()
    yield 'retract', f'{_timed(clock, cnc.retract):.1f} s, {_where(cnc.status())}'
    yield 'health', 'well' if cnc.health.level is not Level.ERROR else cnc.health.message


def _introduced(cnc: Cnc) -> str:
    facts = cnc.description
    settings = ' '.join(f'${number}={facts[f"${number}"]}' for number in SHOWN if f'${number}' in facts)
    return '; '.join(part for part in (_firmware(cnc), settings, facts.get('notes', '')) if part)


def _firmware(cnc: Cnc) -> str:
    return cnc.description['kind'].removeprefix('CNC, ')


def _timed(clock: Clock, act: Callable[[], object]) -> float:
    since_ns = clock.now_ns()
    act()
    return (clock.now_ns() - since_ns) / NS_PER_S


def _where(status: CncStatus) -> str:
    return f'{status.state.value} at {describe_place(status.position_mm)}{"" if status.homed else ", place not known"}'


def _jogged(cnc: Cnc, clock: Clock) -> str:
    """Jog; in steps if a longer jog could not be stopped."""
    before, longest = cnc.status().position_mm[2], cnc.blind_step_mm or 2.0

    def act() -> None:
        for _ in range(round(2.0 / longest)):
            cnc.jog(dz=-longest, feed=SLOW_MM_MIN)
            cnc.wait_idle()

    seconds = _timed(clock, act)
    steps = '' if cnc.blind_step_mm is None else f' in steps of {longest:g} mm'
    return f'{before - cnc.status().position_mm[2]:.3f} mm in {seconds:.1f} s{steps}'


def _stopped(cnc: Cnc, clock: Clock, begin: Callable[[], None]) -> str:
    if cnc.blind_step_mm is not None:
        return f'not tried: it takes jogs of {cnc.blind_step_mm:g} mm only, as it cannot be stopped'
    begin()
    clock.sleep_until(clock.now_ns() + round(GOING_S * NS_PER_S))
    before = cnc.status().position_mm
    seconds = _timed(clock, cnc.stop)
    after = cnc.status()
    way_mm = abs(after.position_mm[0] - before[0])
    return f'returned after {seconds:.2f} s, {way_mm:.2f} mm further, {_where(after)}'


def _many(cnc: Cnc, clock: Clock, x: float) -> str:
    start = cnc.status().position_mm[0]

    def act() -> None:
        for number in range(MOVES):
            cnc.move(x=start + STEP_MM * (number + 1), feed=FAST_MM_MIN)
        cnc.wait_idle()

    seconds = _timed(clock, act)
    went_mm = cnc.status().position_mm[0] - start
    cnc.move(x=x, feed=TRAVEL_MM_MIN)
    cnc.wait_idle()
    return f'{went_mm:.3f} mm in {seconds:.1f} s'


def _switched(cnc: Cnc) -> str:
    widths = [cnc.set_line(level) for level in (True, False)]
    return ', '.join(f'known to {(each.latest_ns - each.earliest_ns) / 1e6:.0f} ms' for each in widths)
