"""The page of the firmware benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.firmware.descent import COMMANDED_MM
from benchmarks.firmware.faults import FAULTS
from benchmarks.harness.report import machine_and_commit
from tactile_nodes.collection.safety import CAMERA, FORCE, MACHINE, OVERLOAD, SENSOR, SILENT_MACHINE

FIRMWARE = 'firmware'
FOLLOWS = {
    FORCE: 'continues, skips this press',
    OVERLOAD: 'waits for a person',
    SENSOR: 'waits for the sensor',
    CAMERA: 'waits for the camera',
    MACHINE: 'ends',
    SILENT_MACHINE: 'waits for the machine, then makes the reference press',
    'driver': 'ends',
}
"""The reaction of a run once the tip is up, by the kind of trip (`tactile_nodes.collection.run`)."""
MORE_MM = 0.25  # beyond the commanded depth: a move to a wrong place is stopped within two reports

INTRODUCTION = f"""# Drivers on real firmware

Tests of the project's drivers with real firmware in its own simulators: basic commands, and faults during a press. The
descent is that of a collection (same drivers and safety functions), at 1 mm/s to a commanded depth of
{COMMANDED_MM:g} mm. The fault occurs at 0.3 mm depth. The force sensor is a Net F/T box behind a proxy, which adds the
force of the paper's gel at the depth that the firmware reports.

- *deepest*: from the firmware's own reports, read before the fault can change them, and once more at the end
- *detected*: time from the fault to the event that stopped the press
- *at rest*: time from the fault to the last report with a new position (ten reports a second; –: no report came)
- *retract*: as in a collection after a fault, the tip is raised, and the force must show that nothing touches
- *final height*: above the gel; if negative, the tip stays where it stopped, for a person to check
- *collection then*: what a collection does after a fault of this kind, once the tip is up
- When the commanding process is killed, only the watchdog program that it had started is left. *detected* is then the
  time until the watchdog first commands the way up, and *at rest* the time until the tip is up.
- If something fails before the press, or a silence that is not part of the fault stops it, the test is repeated, up to
  three times.
- The force may be missing for 0.3 s here, instead of 0.05 s, because the machine had other work."""


def page(result: Mapping[str, Any]) -> str:
    """The page, with one section per firmware."""
    return '\n\n'.join([INTRODUCTION, *(_section(name, each) for name, each in result[FIRMWARE].items())])


def complaints(result: Mapping[str, Any]) -> list[str]:
    """Presses that went on despite a fault, or stopped without a reason."""
    return [
        f'{name}, {FAULTS[fault].title}: {outcome["reached_mm"]:.2f} mm, {outcome["said"] or "nothing was said"}'
        for name, each in result[FIRMWARE].items()
        for fault, outcome in each['faults'].items()
        if 'failed' not in outcome and not _is_right(fault, each['kind'], outcome)
    ]


def _is_right(fault: str, kind: str, outcome: Mapping[str, Any]) -> bool:
    if outcome['reached_mm'] > COMMANDED_MM + MORE_MM:
        return False
    if FAULTS[fault].bounded:
        return True
    if FAULTS[fault].trip not in {'', outcome['kind']} or (FAULTS[fault].kills and outcome['up'] != 'up'):
        return False
    return bool(outcome['said']) != (FAULTS[fault].harmless or (kind == 'marlin' and FAULTS[fault].damages_a_line))


def _section(name: str, each: Mapping[str, Any]) -> str:
    about = f'{each["sources"] or "Sources: not given."}\n\n`{each["command"]}`; {machine_and_commit(each)}.'
    parts = [f'## {name}', about]
    if each['obeys']:
        parts.append(_table(['command', 'result'], list(each['obeys'].items())))
    if each['faults']:
        parts.append(_faults(each['faults']))
        parts += _failed(each['faults'])
    return '\n\n'.join(parts)


def _faults(found: Mapping[str, Any]) -> str:
    heads = [
        'fault',
        'deepest [mm]',
        'detected [s]',
        'at rest [s]',
        'final height [mm]',
        'reason of the stop',
        'retract',
        'collection then',
    ]
    return _table(heads, [_row(FAULTS[name].title, found[name]) for name in FAULTS if name in found])


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table without padding, because its cells contain sentences."""
    rule = ['--:' if '[' in head else '---' for head in heads]
    return '\n'.join(f'| {" | ".join(cells)} |' for cells in [heads, rule, *rows])


def _row(title: str, outcome: Mapping[str, Any]) -> list[str]:
    if 'failed' in outcome:
        return [title, '–', '–', '–', '–', f'not tried: {outcome["failed"]}', '–', '–']
    times = ['–' if outcome[key] is None else f'{outcome[key]:.2f}' for key in ('noticed_s', 'rest_s')]
    places = [f'{outcome[key]:.2f}' for key in ('reached_mm', 'up_mm')]
    return [title, places[0], *times, places[1], outcome['said'] or 'nothing', outcome['up'], _then(outcome)]


def _then(outcome: Mapping[str, Any]) -> str:
    """The reaction of the run; if the tip is not up, it always ends."""
    return '–' if not outcome['kind'] else FOLLOWS.get(outcome['kind'], '–') if outcome['up'] == 'up' else 'ends'


def _failed(found: Mapping[str, Any]) -> list[str]:
    """Failures before a press, which was then repeated."""
    why = [f'{FAULTS[name].title}: {each}' for name in found for each in found[name].get('failed_before', [])]
    return ['Repeated, because something failed before the press:\n\n' + '\n'.join(f'- {each}' for each in why)] * bool(
        why
    )
