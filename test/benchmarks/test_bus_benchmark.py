"""The benchmark of the bus runs and reports; how fast it is depends on the machine, and is nothing to assert."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from benchmarks import bus
from benchmarks.bus.ends import CONTENDERS, PAYLOADS
from benchmarks.harness.report import percentiles, spread, table
from tactile_nodes.cli import bench


def test_bus_benchmark_reports_every_contender_and_payload(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bus, 'QUICK', bus.Plan(rounds=1, messages=5, rate_hz=500.0, flood=20))
    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    assert bench.run(parser.parse_args(['bus', '--quick', '-o', str(tmp_path / 'bus.json')])) == 0
    printed = capsys.readouterr().out
    result = json.loads((tmp_path / 'bus.json').read_text())
    for name in PAYLOADS:
        assert set(result['between_processes_us'][name]) == set(CONTENDERS)
        assert name in printed
    assert set(result['versions']) >= {'python', 'numpy', 'pyzmq'}
    assert result['commit']
    assert '| 440x440 image inside one process, node to node |' in printed


def test_percentiles_are_those_of_the_samples() -> None:
    assert percentiles([float(value) for value in range(101)]) == {'p50': 50.0, 'p90': 90.0, 'p99': 99.0}
    assert spread([3.0, 1.0, 2.0]) == {'median': 2.0, 'low': 1.0, 'high': 3.0}


def test_table_lines_up_its_columns() -> None:
    assert table(['a', 'bcd'], [['xy', '1']]) == '| a  | bcd |\n| -- | --: |\n| xy |   1 |'
