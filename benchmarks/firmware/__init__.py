"""Test the drivers with real firmware in its own simulator: basic commands, and the outcome of faults during a press.

A firmware is named by the command that starts its simulator, which talks on its standard streams; by a network socket;
or by a serial port. At a serial port a real machine moves, so keep its tip free. The user builds the simulator; this
command downloads nothing. The firmware has to be configured as for a rig; its settings are read and never written.
Earlier results that are not measured again are kept.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.firmware.faults import FAULTS, Fault
from benchmarks.firmware.obeys import obeys
from benchmarks.firmware.page import FIRMWARE, complaints, page
from benchmarks.firmware.press import PORT, Machine, press
from benchmarks.harness.declaration import RIG, Benchmark, Result, argument
from benchmarks.harness.report import surroundings
from benchmarks.harness.running import Run
from tactile_nodes.clock import Clock, SystemClock
from tactile_nodes.collection.hands import TrippedError
from tactile_nodes.drivers.cnc.contract import RISKS, CncSettings
from tactile_nodes.errors import ConfigurationError, TactileError

OBEYS = 'obeys'
GRBL_GEL_MM, GRBL_UP_MM = (-20.0, -20.0, -20.0), -19.0
MARLIN_GEL_MM, MARLIN_UP_MM = (20.0, 20.0, 20.0), 21.0
GRBL_LOWEST_MM, GRBL_HIGHEST_MM = (-100.0, -100.0, -50.0), (0.0, 0.0, 0.0)  # FluidNC does not report them
ATTEMPTS = 3
MARLIN_LOWEST_MM, MARLIN_HIGHEST_MM = (0.0, 0.0, 0.0), (120.0, 120.0, 60.0)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure each named firmware; earlier results that are not measured again are kept."""
    firmware: dict[str, Any] = run.earlier().get(FIRMWARE, {})
    result: dict[str, Any] = {FIRMWARE: firmware}
    for machine in machines(arguments):
        found = firmware.setdefault(machine.name, {OBEYS: {}, 'faults': {}})
        found |= {**surroundings(_command(machine, arguments)), 'kind': machine.kind, 'sources': arguments.sources}
        result['command'] = found['command']  # without the user's own paths
        for _ in _tried(machine, found, run):
            run.keep(result)
    return result


def machines(arguments: argparse.Namespace) -> list[Machine]:
    """The named firmwares.

    Raises:
        ConfigurationError: none is named, or one has no name or no command.
    """
    accept = tuple(arguments.accept)
    grbl = CncSettings(lowest_mm=GRBL_LOWEST_MM, highest_mm=GRBL_HIGHEST_MM, safe_z_mm=GRBL_UP_MM, accept=accept)
    marlin = CncSettings(
        kind='marlin',
        lowest_mm=MARLIN_LOWEST_MM,
        highest_mm=MARLIN_HIGHEST_MM,
        safe_z_mm=MARLIN_UP_MM,
        home_command=arguments.home_command,
        accept=accept,
    )
    found = [
        *(Machine(*_named(text), grbl, GRBL_GEL_MM, arguments.net_ft) for text in arguments.grbl),
        *(Machine(*_named(text), marlin, MARLIN_GEL_MM, arguments.net_ft) for text in arguments.marlin),
    ]
    if not found:
        raise ConfigurationError('name at least one firmware with --grbl or --marlin; see --help')
    if arguments.net_ft and not re.fullmatch(r'[^:]+:\d+:\d+', arguments.net_ft):
        raise ConfigurationError(f'--net-ft is HOST:RDT:HTTP with two port numbers, got {arguments.net_ft!r}')
    return found


def _named(text: str) -> tuple[str, str]:
    name, _, source = text.partition('=')
    if not name.strip() or not source.strip():
        raise ConfigurationError(f'a firmware is NAME=COMMAND, got {text!r}')
    return name.strip(), source.strip()


def _tried(machine: Machine, found: dict[str, Any], run: Run) -> Iterator[None]:
    """Do each test in turn, and add its result to `found`."""
    clock, progress, what = SystemClock(), run.progress, run.cases
    with tempfile.TemporaryDirectory(prefix='tf') as folder:
        if OBEYS in what:
            progress.say(f'{machine.name}: what it does without a fault')
            found[OBEYS] = obeys(machine, clock, Path(folder))
            yield
        for name, fault in FAULTS.items():
            if name in what and machine.kind in fault.kinds:
                progress.say(f'{machine.name}: {fault.title}')
                found['faults'][name] = pressed(machine, fault, clock, Path(folder))
                yield


def pressed(machine: Machine, fault: Fault, clock: Clock, folder: Path) -> dict[str, Any]:
    """Press with a fault. Start again if something fails before the press: a simulator may hang on a busy computer."""
    failed: list[str] = []
    for _ in range(ATTEMPTS):
        try:
            return {**asdict(press(machine, fault, clock, folder)), 'failed_before': failed}
        except (TactileError, TrippedError) as error:
            failed.append(str(error).replace(str(folder / PORT), 'it'))
    return {'failed': failed[-1], 'failed_before': failed}


def _command(machine: Machine, arguments: argparse.Namespace) -> str:
    more = f" --home-command '{arguments.home_command}'" if machine.kind == 'marlin' else ''
    accepted = ''.join(f" '{risk}'" for risk in arguments.accept)
    more += f' --accept{accepted}' if accepted else ''
    box = ' --net-ft HOST:RDT:HTTP' if arguments.net_ft else ''
    return f"tactile bench firmware --{machine.kind} '{machine.name}=…'{more}{box} -o docs/results"


BENCHMARK = Benchmark(
    name='firmware',
    about=__doc__,
    sources=('benchmarks/firmware/**', 'benchmarks/devices/**', *RIG),
    page=page,
    measure=measured,
    cases=(OBEYS, *FAULTS),
    failed=lambda result: bool(complaints(result)),
    output=Path('firmware'),
    arguments=(
        argument(
            '--grbl',
            action='append',
            default=[],
            metavar='NAME=COMMAND',
            help='a Grbl, grblHAL or FluidNC; repeatable',
        ),
        argument(
            '--marlin',
            action='append',
            default=[],
            metavar='NAME=COMMAND',
            help='a Marlin, or a firmware with the same protocol; repeatable',
        ),
        argument('--sources', default='', metavar='TEXT', help='the sources of the firmware, for the page'),
        argument('--home-command', default='G28', help='homing command of a Marlin (default: %(default)s)'),
        argument(
            '--accept',
            nargs='+',
            default=[],
            choices=RISKS,
            metavar='RISK',
            help=f'risks to accept, of: {", ".join(map(repr, RISKS))}',
        ),
        argument(
            '--net-ft',
            default='',
            metavar='HOST:RDT:HTTP',
            help='use a Net F/T box without load instead of the emulated one',
        ),
    ),
    example="example: tactile bench firmware --grbl 'Grbl 1.1h=./grbl_sim.exe -n -s /dev/null -b /dev/null'",
)
