"""The benchmark of a hand: what it starts, and what its page says of sensing beside the relay."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from benchmarks import hand
from benchmarks.gaps import Gaps
from benchmarks.hand import sensing
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import Run
from tactile_nodes.bus.protocol import Received
from tactile_nodes.conversions import header
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.launching.hand import parameter_text
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types
from tactile_nodes.sensors import load_hand

MEASURED = {
    'forces': 7200,
    'skipped': 3,
    'lost': 0,
    'p50_ms': 3.0,
    'worst_ms': 21.0,
    'longest_ms': 33.3,
    'cores': 0.115,
}


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    (tmp_path / 'pictures').mkdir()
    (tmp_path / 'live.yaml').write_text('/**/camera: {ros__parameters: {fps: 60.0, loop: true}}\n', encoding='ascii')
    found = f'source:={tmp_path / "pictures"}', f'config:={tmp_path / "live.yaml"}'
    monkeypatch.setattr(sensing, 'recorded_camera', lambda _: found)
    return tmp_path


def test_a_hand_of_four_reads_the_same_pictures_at_the_rate_that_is_asked_for(pictures: Path) -> None:
    made = load_hand(sensing.written(pictures, 4, 30.0, 'fast', floods=False))
    assert made.refused == ()
    assert made.names == ('s0', 's1', 's2', 's3')
    rates = [yaml.safe_load(parameter_text(each, made, open_within_s=0.0)) for each in made.sensors]
    assert [each['/**/camera']['ros__parameters']['fps'] for each in rates] == [30.0] * 4


def test_one_that_floods_brings_ten_times_as_many(pictures: Path) -> None:
    made = load_hand(sensing.written(pictures, 2, 30.0, 'fast', floods=True))
    flooding, calm = (yaml.safe_load(parameter_text(each, made, open_within_s=0.0)) for each in made.sensors)
    assert flooding['/s0/camera']['ros__parameters']['fps'] == 300.0
    assert '/s0/camera' not in calm


def test_gaps_are_counted_in_frames_of_the_rate() -> None:
    gaps = Gaps(frame_ns=1e9 / 30)
    for number, frame in enumerate((0, 1, 4)):
        message = types.ForceDistribution(header=header(1_000_000_000 + round(frame * 1e9 / 30), 'gel'))
        gaps.take(Received('', 'one', number + 1, 0, 0, message=message))
    assert gaps.skipped == 2
    assert gaps.longest_ms == pytest.approx(100.0, abs=1e-3)


def test_the_page_tells_how_far_over_the_relay_it_is_and_what_troubles_did(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))  # where parts of a run are kept
    late = {hand.SENSED: 6.25, hand.RELAYED: 4.5}
    monkeypatch.setattr(hand, '_hand', lambda *words: {**MEASURED, 'p99_ms': late[words[3]]})
    asked = parser_of(hand.BENCHMARK).parse_args(['--sensors', '4', '--hz', '60', '--models', 'fast'])
    run = Run(hand.BENCHMARK, asked, Progress())
    text = hand.page(run.keep(hand.measured(asked, run)))
    sensed = next(line for line in text.splitlines() if f'| {hand.SENSED} |' in ' '.join(line.split()))
    assert [cell.strip() for cell in sensed.split('|')[1:-1]] == [
        '4', '60', 'fast', 'sensing', '7200', '3', '0', '3.00', '6.25', '1.75', '21.0', '33.3', '11.5%',
    ]  # fmt: skip
    assert 'hangs' in text
    assert '4 sensors at 60 Hz, `fast`' in text


def test_hands_and_rates_come_in_pairs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    asked = parser_of(hand.BENCHMARK).parse_args(['--sensors', '4', '8', '--hz', '60'])
    with pytest.raises(ConfigurationError, match='--hz wants a rate for each of --sensors'):
        hand.measured(asked, Run(hand.BENCHMARK, asked, Progress()))
