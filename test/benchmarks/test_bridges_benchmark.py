"""The benchmark of bridges runs and reports; how fast they are depends on the machine, and is nothing to assert."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import bridges
from benchmarks.bridges import hosts
from benchmarks.bridges.network import Cable, network
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import run
from benchmarks.streams import streams
from tactile_nodes.errors import ConfigurationError


@pytest.fixture
def two_hosts() -> None:
    try:
        with network() as made:
            made.lay(Cable(mbit=100.0, loss_percent=1.0))  # needs tc and iptables
    except ConfigurationError as error:
        pytest.skip(str(error))


@pytest.mark.timeout(300)
@pytest.mark.usefixtures('two_hosts')
def test_bridges_benchmark_reports_a_cable_and_its_troubles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bridges, 'CABLES', {bridges.GOOD: bridges.CABLES[bridges.GOOD]})
    monkeypatch.setattr(hosts, 'STREAMS', streams(['/s0'], ['/s0']))
    monkeypatch.setattr(bridges, 'CUT_S', 0.2)
    monkeypatch.setattr(bridges, 'SETTLING_S', 0.2)
    words = ['--seconds', '0.5', '--rounds', '1', '--no-dds', '-o', str(tmp_path)]
    assert run(bridges.BENCHMARK, parser_of(bridges.BENCHMARK).parse_args(words)) == 0
    assert '# Between machines' in capsys.readouterr().out
    contenders = json.loads((tmp_path / 'bridges.json').read_text())['contenders']
    assert list(contenders) == [bridges.OURS, bridges.FOUND]
    for found in contenders.values():
        good = found['cables'][0][bridges.GOOD]
        for kind in ('forces', 'pictures'):
            assert 0.0 < good[kind]['came'] <= 1.0
            assert good[kind]['p50'] > 0.0
        (troubles,) = found['troubles']
        assert troubles['back_s'] > 0.0
        assert troubles['again_s'] > 0.0
        assert troubles['stranger'] == 0
