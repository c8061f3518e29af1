"""The page of the faults of the whole system, and what of it is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.harness.report import columns, machine_and_commit, shown

RECOVERS_S = 2.0
HEAD = """# Faults of the whole system

What happens to live sensing when processes are killed, files of the bus are removed, garbage is sent, or there is too
much of everything; and what is left of files that were cut off or altered. Faults during a collection: `faults.md`.
Hours of sensing: `endurance.md`. All of it is simulation, on the machine named below each table, which had other work:
*load* is how many processes wanted its processors.
"""


KILLS = """\
The tip holds the gel down when the process is killed, and for seconds after; the model in use is one that was set while
it ran. *Stream back*: until the end of the longest gap between forces that are not invalid, 0 if it is
below 0.25 s. *After*: error against the
truth in the same touch, once the stream is back; a rest image taken of the touched gel would show there as the whole
force. –: no touch was left, or nothing came in 20 s."""
GARBAGE = """\
{frames} frames of random bytes to the {sockets} sockets of a live launch, and {messages} messages with a header in
order and random bytes behind it on {topics} topics, from a forged participant: {died} died, {bugs} lines of a
traceback, and {forces_after} forces came in the 4 s after."""
BROKER = """\
There is none to kill: each process keeps a locked file and its record in the run folder, and each publisher a socket. A
bridge between machines that is killed, and comes again, is in `test/bus/bridge/test_bridge.py`; a subscriber that is
stopped (SIGSTOP) in `test/bus/zeromq/test_between_processes.py`: neither the publisher nor healthy subscribers are
slower for it, and memory stays bounded."""
CROWD = """\
{nodes} processes of one node each: {started_s:.0f} s until the last had started, {known_s:.2f} s more until another one
knew them all; at rest all together take {cores:.2f} of a processor, and each has {own_mb:.0f} MiB of its own (load
{load:.0f})."""
SENSORS = """\
Sensors in namespaces of their own on one bus, cameras in one process, flow features and force estimators in two, images
of 128x128 pixels, 5 s a rate. *Mixed*: answers to the image of another sensor."""
FILES = """\
Bags were cut after each byte, and compared message by message with what was written; of model files one byte at a time
was altered, the first 64 and others drawn by chance."""


def complaints(parts: Mapping[str, Any]) -> list[str]:
    """What is wrong, in words."""
    checks: dict[str, Callable[[Any], list[str]]] = {'kills': _kills, 'bus': _bus, 'crowd': _crowd, 'files': _files}
    return [text for name, check in checks.items() if name in parts for text in check(parts[name])]


def page(parts: Mapping[str, Any]) -> str:
    """All tables there are."""
    makers = {'kills': kills_page, 'bus': bus_page, 'crowd': crowd_page, 'files': files_page}
    texts = [HEAD.strip()]
    for name, make in makers.items():
        if name in parts:
            texts += [*make(parts[name]), f'`{parts[name]["command"]}`; {machine_and_commit(parts[name])}.']
    wrong = complaints(parts)
    texts.append('## Wrong\n\n' + ('\n'.join(f'- {text}' for text in wrong) if wrong else 'Nothing.'))
    return '\n\n'.join(texts)


def kills_page(part: Mapping[str, Any]) -> list[str]:
    shown_kills = columns(
        part['kills'],
        ('kill -9 of', '{process}'), ('stream back', lambda each: _seconds(each['blind_s'])),
        ('images missed', '{missed}'), ('node back', lambda each: _seconds(each['back_s'])),
        ('worst error before', lambda each: _mn(each['before_n'])), ('after', lambda each: _mn(each['after_n'])),
        ('rest image', lambda each: _same(each['same_rest'])), ('model', lambda each: _same(each['same_model'])),
        ('load', '{load:.0f}'),
    )  # fmt: skip
    found = [f'{each["process"]}: {each["found"]}.' for each in part['kills'] if each['found']]
    return ['## kill -9 of each process of live sensing', KILLS, shown_kills, *found]


def bus_page(part: Mapping[str, Any]) -> list[str]:
    sent = part['garbage']
    spoilt = columns(
        part['spoilt'],
        ('what is done to the run folder', '{what}'), ('forces in 4 s before', '{before}'), ('after', '{forces}'),
        ('newcomer hears after', lambda each: _seconds(each['newcomer_s'])), ('died', _died), ('load', '{load:.0f}'),
    )  # fmt: skip
    return [
        '## Garbage on the bus',
        GARBAGE.format(**{**sent, 'died': _died(sent), 'bugs': len(sent['bugs'])}),
        f'Told, once a topic and node, in {len(sent["told"])} warnings, such as: `{(sent["told"] or ["none"])[0]}`',
        '## No broker',
        BROKER,
        spoilt,
    ]


def _died(each: Mapping[str, Any]) -> str:
    return ', '.join(each['died']) or 'nobody'


def crowd_page(part: Mapping[str, Any]) -> list[str]:
    sensors = columns(
        part['sensors'],
        ('images a second, each', '{rate_hz:g}'), ('answered', '{answered:.1%}'), ('fewest', '{least:.1%}'),
        ('late, median', '{late_ms[p50]:.0f} ms'), ('99 %', '{late_ms[p99]:.0f} ms'), ('mixed', '{mixed}'),
        ('load', '{load:.0f}'),
    )  # fmt: skip
    return ['## Crowds', CROWD.format(**part['nodes']), SENSORS, sensors]


def files_page(part: Mapping[str, Any]) -> list[str]:
    files = columns(
        [*part['bags'], *part['models']],
        ('file', '{what}'), ('tried', '{tried}'),
        ('outcomes', lambda each: ', '.join(f'{n} {what}' for what, n in each['outcomes'].items())),
        ('wrong', lambda each: str(len(each['wrong']))),
    )  # fmt: skip
    return ['## Files cut off and altered', FILES, files]


def _kills(part: Mapping[str, Any]) -> list[str]:
    found = []
    for each in part['kills']:
        if not each['blind_s'] <= RECOVERS_S:
            found.append(f'{each["process"]}: the stream was back after {_seconds(each["blind_s"])}, not within 2 s')
        if False in {each['same_rest'], each['same_model']}:
            found.append(f'{each["process"]}: rest image or model were others afterwards')
    return found


def _bus(part: Mapping[str, Any]) -> list[str]:
    found = [*(f'garbage: {name} died' for name in part['garbage']['died']), *part['garbage']['bugs'][:3]]
    bad = (each for each in part['spoilt'] if each['died'] or not each['forces'] or math.isnan(each['newcomer_s']))
    return [
        *found,
        *(f'{each["what"]}: {each["forces"]} forces, newcomer {_seconds(each["newcomer_s"])}' for each in bad),
    ]


def _crowd(part: Mapping[str, Any]) -> list[str]:
    return [
        f'{each["mixed"]} answers to another sensor at {each["rate_hz"]:g} Hz'
        for each in part['sensors']
        if each['mixed']
    ]


def _files(part: Mapping[str, Any]) -> list[str]:
    return [str(text) for each in (*part['bags'], *part['models']) for text in each['wrong']]


def _seconds(value: float) -> str:
    return shown(value, '{:.2f} s')


def _mn(value: float) -> str:
    return shown(1000 * value, '{:.0f} mN')


def _same(same: bool | None) -> str:
    return {True: 'the same', False: 'another', None: '–'}[same]
