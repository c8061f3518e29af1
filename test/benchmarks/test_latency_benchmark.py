"""The benchmark of live latency: what it counts, and that a slow rate from memory is held."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks import latency
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import Run
from benchmarks.latency import rates
from tactile_nodes.learning.progress import Progress

LIVE = {
    'model': 'fast', 'arrangement': 'a process each', 'forces': 600, 'skipped': 2, 'lost': 1, 'p50_ms': 3.4,
    'p99_ms': 9.0, 'worst_ms': 20.0, 'longest_ms': 50.0, 'stages_p50_ms': dict.fromkeys(latency.STAGES, 0.5),
    'cpu_share': {'camera_node': 0.2},
}  # fmt: skip


def test_a_slow_rate_from_memory_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rates, 'KINDS', {'mixed': 2})
    (held,) = rates.highest('fast', False, [2], 1.0, Progress()).values()
    assert held.rate_hz == 2
    assert 0 < held.p99_ms < 10_000
    assert 0 < held.cpu_ms < 1000
    assert held.next_hz is None


def test_the_page_tells_losses_and_rates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))  # where parts of a run are kept
    monkeypatch.setattr(latency, '_live', lambda *_: LIVE)
    held: dict[str, Any] = {'held': 300, 'p99_ms': 2.5, 'cpu_ms': 0.8, 'next': 400}
    monkeypatch.setattr(latency, '_rates', lambda *_: {'mixed': held})
    monkeypatch.setattr(latency, 'recorded_camera', lambda _: ('source:=somewhere', 'config:=else'))
    words = ['--minutes', '0.1', '--compiled', '--seconds', '1', '--rates', '300', '400']
    asked = parser_of(latency.BENCHMARK).parse_args(words)
    run = Run(latency.BENCHMARK, asked, Progress())
    text = latency.page(run.keep(latency.measured(asked, run)))
    assert '$ tactile bench latency --minutes 0.1 --compiled --seconds 1 --rates 300 400' in text
    assert '600 |       2 |    1 |' in text
    assert 'compiled |  mixed |       300 |     2.50 |             0.80 |               400 |' in text
