"""The effort of a collection as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from benchmarks.harness.report import table
from tactile_nodes.collection.plan.progress import duration

MB = 1e6


def page_text(result: Mapping[str, Any]) -> str:
    """A table of the collection, and one of its topics."""
    sessions = result['sessions']
    recorded, rejected, simulated_s, real_s = (
        sum(each[name] for each in sessions) for name in ('recorded', 'rejected', 'simulated_s', 'real_s')
    )
    rows = [
        ['presses of the plan', str(result['presses'])],
        ['recorded', str(recorded)],
        ['attempts rejected', str(rejected)],
        ['sessions', str(len(sessions))],
        ['simulated time', duration(simulated_s)],
        ['the plan, estimated before', duration(result['estimated_s'])],
        ["the machine's own limit", duration(result['machine_s'])],
        ['real time', duration(real_s)],
        ['faster than real time', f'{simulated_s / real_s:.0f} times'],
        ['on disk', f'{result["disk_bytes"] / MB:.0f} MB'],
    ]
    return f'{sessions[-1]["ended"]}\n\n{table(["", "value"], rows)}\n\n{_topics(sessions)}'


def _topics(sessions: list[dict[str, Any]]) -> str:
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    for each in sessions:
        counts.update(each['messages'])
        sizes.update(each['payload_bytes'])
    rows = [[name, str(counts[name]), f'{size / MB:.1f} MB'] for name, size in sizes.most_common()]
    rows.append(['all', str(sum(counts.values())), f'{sum(sizes.values()) / MB:.1f} MB'])
    return table(['topic', 'messages', 'before compression'], rows)
