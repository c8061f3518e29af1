"""The benchmark of DDS runs and reports; how fast it is depends on the machine, and is nothing to assert."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from benchmarks import dds
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import run


@pytest.mark.timeout(180)
def test_dds_benchmark_reports_what_a_reader_gets_and_what_the_bus_notices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('cyclonedds', reason="Cyclone DDS is not installed: pip install 'tactile_nodes[dds]'")
    monkeypatch.setattr(dds, 'CASES', {'a reader': ('bridge', 'reader')})
    words = ['--seconds', '0.3', '--rate', '30', '--domain', str(20 + os.getpid() % 80), '-o', str(tmp_path)]
    assert run(dds.BENCHMARK, parser_of(dds.BENCHMARK).parse_args(words)) == 0
    assert 'force_distribution' in capsys.readouterr().out
    case = json.loads((tmp_path / 'dds.json').read_text())['cases']['a reader']
    for topic in ('image_raw', 'force_distribution'):
        for end in ('bus', 'dds'):
            assert case['topics'][topic][end]['received'] + case['topics'][topic][end]['lost'] > 0
            assert case['topics'][topic][end]['p50'] > 0
    assert '# Cost of DDS' in (tmp_path / 'dds.md').read_text()
