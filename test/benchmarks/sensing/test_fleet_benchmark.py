"""The bench of what a fleet of gels teaches, on hardly any."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import fleet
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import run
from tactile_nodes import sensors

TAUGHT = fleet._taught


def one_taught(make: fleet.Make) -> dict[str, Any]:
    """What the first gel of the fleet tells; each later one differs from it by some per cent."""
    found, more = first_taught(make.seed), 1 + 0.1 * make.number
    return {'gain': more * found['gain'], 'camera': [more * each for each in found['camera']]}


@cache
def first_taught(seed: int) -> dict[str, Any]:
    return TAUGHT(fleet.Make(0, seed))


def test_few_presses_tell_where_the_camera_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in {'PRESSES': 6, 'FEW': (6,), 'JUDGED': 8, '_taught': one_taught}.items():
        monkeypatch.setattr(fleet, name, value)
    monkeypatch.setattr('tactile_nodes.learning.field.fit.UNEXPLAINED', np.inf)  # without a try of free and held sides
    coarse = dataclasses.replace(sensors.load_sensor('simulated'), bins=sensors.BinSettings(4, 4))
    monkeypatch.setattr(sensors, 'load_sensor', {'simulated': coarse}.get)
    words = ['--gels', '2', '--unseen', '1', '--processes', '1', '-o', str(tmp_path)]
    assert run(fleet.BENCHMARK, parser_of(fleet.BENCHMARK).parse_args(words)) == 0
    assert '# A prior from many gels' in capsys.readouterr().out
    (read,) = json.loads((tmp_path / 'fleet.json').read_text())['read']
    assert read[f'6, {fleet.NONE}']['centre_mm'] < 0.5 * read['description']['centre_mm']
    assert read[f'6, {fleet.NONE}']['centre_mm'] < 0.5 * read[f'6, {fleet.FIXED}']['centre_mm']
