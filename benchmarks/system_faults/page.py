"""The page of the faults of the whole system, and the list of failures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.harness.report import columns, machine_and_commit, shown

RECOVERS_S = 2.0
HEAD = """# Faults of the whole system

The effect of killed processes, removed files of the bus, invalid messages and overload on live sensing; and of
truncation and changed bytes on files. Faults during a collection are in `faults.md`, hours of sensing in
`endurance.md`. The sensors are simulated. The machine is named below each table; *load* is its load average, which
includes other work.
"""


KILLS = """\
The tip presses the gel when the process is killed, and for seconds after. The model in use was set by a parameter while
the launch ran. *recovery*: time to the end of the longest gap between forces that are not invalid; 0 if the gap is
below 0.25 s. *after*: force error in the same touch, after the recovery. If the rest image had been captured while
touched, the error would be the whole force. –: the touch was over, or nothing came in 20 s."""
GARBAGE = """\
{frames} frames of random bytes were sent to the {sockets} sockets of a live launch, and {messages} messages with a
valid header and random content on {topics} topics, from a forged participant. Processes that died: {died}. Lines of
tracebacks: {bugs}. Forces in the 4 s after: {forces_after}."""
BROKER = """\
There is no broker that could be killed: each process has a locked file and its record in the run folder, and each
publisher has a socket. `test/bus/bridge/test_bridge.py` tests a bridge between machines that is killed and restarted.
`test/bus/zeromq/test_between_processes.py` tests a subscriber that is stopped (SIGSTOP): it slows down neither the
publisher nor other subscribers, and memory stays bounded."""
CROWD = """\
{nodes} processes with one node each: the last had started after {started_s:.0f} s, and {known_s:.2f} s later another
node had discovered them all. At rest they use {cores:.2f} of a core together, and {own_mb:.0f} MiB of private memory
each (load {load:.0f})."""
SENSORS = """\
Sensors in separate namespaces on one bus: cameras in one process, flow features and force estimators in two, images of
128x128 pixels, 5 s per rate. *mixed*: forces for the image of another sensor."""
FILES = """\
Bags were truncated after each byte, and compared message by message with the original. In model files one byte at a
time was changed: each of the first 64, and others at random."""


def complaints(parts: Mapping[str, Any]) -> list[str]:
    """The failures, as sentences."""
    checks: dict[str, Callable[[Any], list[str]]] = {'kills': _kills, 'bus': _bus, 'crowd': _crowd, 'files': _files}
    return [text for name, check in checks.items() if name in parts for text in check(parts[name])]


def page(parts: Mapping[str, Any]) -> str:
    """The page with the tables of all measured parts."""
    makers = {'kills': kills_page, 'bus': bus_page, 'crowd': crowd_page, 'files': files_page}
    texts = [HEAD.strip()]
    for name, make in makers.items():
        if name in parts:
            texts += [*make(parts[name]), f'`{parts[name]["command"]}`; {machine_and_commit(parts[name])}.']
    wrong = complaints(parts)
    texts.append('## Problems found\n\n' + ('\n'.join(f'- {text}' for text in wrong) if wrong else 'None.'))
    return '\n\n'.join(texts)


def kills_page(part: Mapping[str, Any]) -> list[str]:
    shown_kills = columns(
        part['kills'],
        ('kill -9 of', '{process}'), ('recovery', lambda each: _seconds(each['blind_s'])),
        ('images missed', '{missed}'), ('node restarted', lambda each: _seconds(each['back_s'])),
        ('largest error before', lambda each: _mn(each['before_n'])), ('after', lambda each: _mn(each['after_n'])),
        ('rest image', lambda each: _same(each['same_rest'])), ('model', lambda each: _same(each['same_model'])),
        ('load', '{load:.0f}'),
    )  # fmt: skip
    found = [f'{each["process"]}: {each["found"]}.' for each in part['kills'] if each['found']]
    return ['## kill -9 of each process of live sensing', KILLS, shown_kills, *found]


def bus_page(part: Mapping[str, Any]) -> list[str]:
    sent = part['garbage']
    spoilt = columns(
        part['spoilt'],
        ('damage to the run folder', '{what}'), ('forces in 4 s before', '{before}'), ('after', '{forces}'),
        ('new subscriber receives after', lambda each: _seconds(each['newcomer_s'])), ('died', _died),
        ('load', '{load:.0f}'),
    )  # fmt: skip
    return [
        '## Invalid messages on the bus',
        GARBAGE.format(**{**sent, 'died': _died(sent), 'bugs': len(sent['bugs'])}),
        f'{len(sent["told"])} warnings, one per topic and node, such as: `{(sent["told"] or ["none"])[0]}`',
        '## No broker',
        BROKER,
        spoilt,
    ]


def _died(each: Mapping[str, Any]) -> str:
    return ', '.join(each['died']) or 'none'


def crowd_page(part: Mapping[str, Any]) -> list[str]:
    sensors = columns(
        part['sensors'],
        ('images a second, each', '{rate_hz:g}'), ('with force', '{answered:.1%}'), ('worst sensor', '{least:.1%}'),
        ('latency p50', '{late_ms[p50]:.0f} ms'), ('p99', '{late_ms[p99]:.0f} ms'), ('mixed', '{mixed}'),
        ('load', '{load:.0f}'),
    )  # fmt: skip
    return ['## Many nodes and sensors', CROWD.format(**part['nodes']), SENSORS, sensors]


def files_page(part: Mapping[str, Any]) -> list[str]:
    files = columns(
        [*part['bags'], *part['models']],
        ('file', '{what}'), ('tried', '{tried}'),
        ('results', lambda each: ', '.join(f'{n} {what}' for what, n in each['outcomes'].items())),
        ('wrong', lambda each: str(len(each['wrong']))),
    )  # fmt: skip
    return ['## Truncated and changed files', FILES, files]


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
