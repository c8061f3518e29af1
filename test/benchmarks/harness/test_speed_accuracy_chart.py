"""The chart of speed against accuracy: it shows the numbers of both results, and its names cover nothing."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.speed_accuracy import CHART, CONTACTS, TIPS, box_of, contact_marks, draw_tips, panel, tip_marks

RESULTS = Path(__file__).parents[3] / 'docs' / 'results'
KEPT = {TIPS: 'front.json', CONTACTS: 'contacts.json'}


def kept(name: str) -> Any:
    return json.loads((RESULTS / KEPT[name]).read_text(encoding='utf-8'))


@pytest.mark.parametrize('name', KEPT)
def test_every_model_is_named_and_no_name_covers_another(name: str) -> None:
    pytest.importorskip('matplotlib')
    from tactile_nodes.learning.figures import figure

    axis = figure(7.5, 6.5).subplots()
    result = kept(name)
    labels = panel(axis, name, result)
    marks = tip_marks(result) if name == TIPS else contact_marks(result)
    assert sorted(label.get_text() for label in labels) == sorted(mark.name for mark in marks)
    boxes = [box_of(label) for label in labels]
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_marks_are_the_kept_numbers_and_say_what_ships() -> None:
    each = {'cpu_ms': 3.0, 'cpu_95_ms': 9.0, 'misplaced': 0.125}
    names = ('paper', 'field, 100 presses', 'field, no presses')
    marks = contact_marks({'models': dict.fromkeys(names, each)})
    assert [(mark.name, mark.shipped) for mark in marks] == [
        ('paper', True),
        ('field, 100 presses', False),
        ('field, no presses', False),
    ]
    assert {(mark.time_ms, mark.error, mark.slow_ms) for mark in marks} == {(3.0, 12.5, 9.0)}
    profile = {'cpu_ms': {'median': 1.0}, 'chain_cpu_ms': {'median': 2.0}, 'armse_n': 0.0003}
    few = {'way': 'ours, full size', 'readout': 'axisymmetric', 'cpu_ms': {'median': 4.0}, 'armse_n': 0.0005}
    others = {'ours': few, 'DIS': {**few, 'way': 'DIS'}, 'response': {**few, 'readout': 'response'}}
    marks = tip_marks({'plan': {'train': 300}, 'profiles': {'fast': profile}, 'contenders': others})
    assert [(mark.name, mark.time_ms, mark.error, mark.shipped) for mark in marks] == [
        ('fast', 2.0, pytest.approx(0.3), True),
        ('portable, 300 presses', 4.0, pytest.approx(0.5), False),
    ]


def test_one_result_alone_is_one_panel(tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    profiles = {name: {'chain_cpu_ms': {'median': 2.0}, 'armse_n': 0.0003} for name in ('fast', 'paper')}
    draw_tips({'contenders': {}, 'profiles': profiles}, tmp_path, 'front')
    assert (tmp_path / CHART).read_bytes().startswith(b'\x89PNG')
