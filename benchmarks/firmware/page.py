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
    FORCE: 'goes on, this point aside',
    OVERLOAD: 'waits for a person',
    SENSOR: 'waits for the sensor',
    CAMERA: 'waits for the camera',
    MACHINE: 'ends',
    SILENT_MACHINE: 'waits for the machine, then presses the anchor',
    'driver': 'ends',
}
"""What a run does once the tip is up, by the kind of trip (`tactile_nodes.collection.run`)."""
MORE_MM = 0.25  # than was commanded: what is sent elsewhere is stopped within two reports

INTRODUCTION = f"""# Drivers on real firmware

What real firmware, in its own simulators, does with the project's drivers, and what each fault comes to. The descent is
that of a collection (drivers, hands, safety, guard): 1 mm/s down, the fault at 0.3 mm depth, {COMMANDED_MM:g} mm
commanded. The force sensor is a Net F/T box behind a proxy that adds what the paper's gel gives at the depth that the
firmware reports.

- Deepest: by the firmware's own reports, heard before the fault can change them, and asked for once more in the end.
- Noticed: from the fault to what stopped the press. At rest: from the fault to the last report of another place (ten
  reports a second; –: none came).
- The way up is that of a collection after a fault: a retract, and a force that says that nothing touches. In the end:
  height above the gel; below 0, the tip is left where it stopped, for a person to look at.
- A run then: what a collection does once the tip is up after a fault of this kind.
- A process that is killed is one of its own, and nobody is left but the program that it had started to watch over the
  machine. Noticed: when that first says the way up; at rest: when the tip is up.
- What fails before the press is begun again, up to three times; so is a press that a silence stopped which is not its
  fault.
- A force may be missing for 0.3 s here, instead of 0.05 s: the machine had other work."""


def page(result: Mapping[str, Any]) -> str:
    """All firmware, one after the other."""
    return '\n\n'.join([INTRODUCTION, *(_section(name, each) for name, each in result[FIRMWARE].items())])


def complaints(result: Mapping[str, Any]) -> list[str]:
    """Presses that went on though something was wrong, or stopped though nothing was."""
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
    about = f'{each["sources"] or "Sources: not told."}\n\n`{each["command"]}`; {machine_and_commit(each)}.'
    parts = [f'## {name}', about]
    if each['obeys']:
        parts.append(_table(['asked for', 'what came of it'], list(each['obeys'].items())))
    if each['faults']:
        parts.append(_faults(each['faults']))
        parts += _failed(each['faults'])
    return '\n\n'.join(parts)


def _faults(found: Mapping[str, Any]) -> str:
    heads = [
        'fault',
        'deepest [mm]',
        'noticed [s]',
        'at rest [s]',
        'in the end [mm]',
        'what stopped it',
        'the way up',
        'a run then',
    ]
    return _table(heads, [_row(FAULTS[name].title, found[name]) for name in FAULTS if name in found])


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Without filling: sentences stand in it."""
    rule = ['--:' if '[' in head else '---' for head in heads]
    return '\n'.join(f'| {" | ".join(cells)} |' for cells in [heads, rule, *rows])


def _row(title: str, outcome: Mapping[str, Any]) -> list[str]:
    if 'failed' in outcome:
        return [title, '–', '–', '–', '–', f'not tried: {outcome["failed"]}', '–', '–']
    times = ['–' if outcome[key] is None else f'{outcome[key]:.2f}' for key in ('noticed_s', 'rest_s')]
    places = [f'{outcome[key]:.2f}' for key in ('reached_mm', 'up_mm')]
    return [title, places[0], *times, places[1], outcome['said'] or 'nothing', outcome['up'], _then(outcome)]


def _then(outcome: Mapping[str, Any]) -> str:
    """Where the tip is not up, a run ends whatever it was."""
    return '–' if not outcome['kind'] else FOLLOWS.get(outcome['kind'], '–') if outcome['up'] == 'up' else 'ends'


def _failed(found: Mapping[str, Any]) -> list[str]:
    """What failed on the way to a press, which was then begun again."""
    why = [f'{FAULTS[name].title}: {each}' for name in found for each in found[name].get('failed_before', [])]
    return ['Begun again, as something failed before the press:\n\n' + '\n'.join(f'- {each}' for each in why)] * bool(
        why
    )
