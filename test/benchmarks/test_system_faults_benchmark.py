"""The bench of faults of the whole system: its files part, how it judges, and its page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pytest

from benchmarks import system_faults
from benchmarks.system_faults.files import bag_cuts, model_bytes
from benchmarks.system_faults.kills import blindness
from benchmarks.system_faults.page import complaints, page
from benchmarks.system_faults.sensor import Seen
from tactile_nodes.learning.progress import Progress

S = 1_000_000_000


def seen(at_s: float) -> Seen:
    return Seen(round(at_s * S), round(at_s * S) - 10_000_000, 0, 0.5, 'rest', 'model')


def test_a_bag_is_read_up_to_the_cut_wherever_it_is_cut(tmp_path: Path) -> None:
    for found in bag_cuts(tmp_path, Progress(), every=97):
        assert found['wrong'] == []
        assert found['outcomes']['read up to the cut'] > 0
        assert sum(found['outcomes'].values()) == found['tried']


def test_each_altered_byte_of_a_model_that_ships_is_refused(tmp_path: Path) -> None:
    found = model_bytes(tmp_path, 'portable', 100, Progress())
    assert found['wrong'] == []
    assert found['outcomes'] == {'refused in one sentence': 100}


def test_the_stream_is_back_at_the_end_of_its_longest_gap() -> None:
    back_s, missed = blindness(0, [seen(0.1), seen(0.2), seen(1.5), seen(1.6)])
    assert back_s == pytest.approx(1.5)
    assert missed == 77  # 1.3 s hold 78 periods of a sixtieth


def test_a_crowd_meets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TACTILE_RUN_DIR', str(tmp_path / 'r'))
    part = system_faults.measure('crowd', argparse.Namespace(quick=True), tmp_path / 'crowd', Progress())
    assert part['nodes']['nodes'] == 4
    assert [each['mixed'] for each in part['sensors']] == [0]
    assert part['sensors'][0]['answered'] > 0.2


def kill(**other: Any) -> dict[str, Any]:
    row = {
        'process': 'camera_node', 'blind_s': 1.0, 'missed': 60, 'back_s': 0.9, 'before_n': 0.01, 'after_n': 0.01,
        'same_rest': True, 'same_model': True, 'found': '', 'load': 1.0,
    }  # fmt: skip
    return {**row, **other}


@pytest.mark.parametrize(
    ('change', 'complaint'),
    [
        ({}, ''),
        ({'blind_s': 2.5}, 'back after 2.50 s'),
        ({'blind_s': float('nan')}, 'back after –'),
        ({'same_rest': False}, 'rest image or model'),
    ],
)
def test_a_kill_is_judged_by_recovery_rest_image_and_model(change: dict[str, Any], complaint: str) -> None:
    found = complaints({'kills': {'kills': [kill(**change)]}})
    assert bool(found) == bool(complaint)
    assert complaint in ''.join(found)


def test_the_page_shows_what_was_measured_and_what_is_wrong() -> None:
    machine = {'processor': 'a', 'cores_allowed': 2, 'load_before': [1.0]}
    text = page({'kills': {'command': 'c', 'machine': machine, 'commit': 'x', 'kills': [kill(blind_s=3.0)]}})
    assert '| camera_node' in text
    assert '- camera_node: the stream was back after 3.00 s' in text
