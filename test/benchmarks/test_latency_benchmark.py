"""The benchmark of live latency: what it counts, and that a slow rate from memory is held."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks import latency
from benchmarks.harness.command import parser_of
from benchmarks.harness.running import Run
from benchmarks.latency import rates, relay
from tactile_nodes import conversions, paths
from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import SteppedClock
from tactile_nodes.launching.packages import command_of
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import stamp_ns, types

START_NS = 1_700_000_000_000_000_000

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
    for part in ('_live', '_relayed'):
        monkeypatch.setattr(latency, part, lambda *_: LIVE)
    held: dict[str, Any] = {'held': 300, 'p99_ms': 2.5, 'cpu_ms': 0.8, 'next': 400}
    monkeypatch.setattr(latency, '_rates', lambda *_: {'mixed': held})
    monkeypatch.setattr(latency, 'recorded_camera', lambda _: ('source:=somewhere', 'config:=else'))
    words = ['--minutes', '0.1', '--compiled', '--seconds', '1', '--rates', '300', '400']
    asked = parser_of(latency.BENCHMARK).parse_args(words)
    run = Run(latency.BENCHMARK, asked, Progress())
    text = latency.page(run.keep(latency.measured(asked, run)))
    assert '$ tactile bench latency --minutes 0.1 --compiled --seconds 1 --rates 300 400' in text
    assert '600 |       2 |    1 |' in text
    assert 'compiled |  mixed |               300 |     2.50 |               0.80 |            400 |' in text


def test_a_relay_answers_each_picture_with_what_was_reported_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(relay.FOLDER, str(tmp_path))
    head = conversions.header(START_NS, 'elsewhere')
    relay.keep(tmp_path, topics.FLOW_FEATURES, types.FlowFeatures(header=head, reference_id='another'))
    relay.keep(tmp_path, topics.FORCE_DISTRIBUTION, types.ForceDistribution(header=head, total=1.5))
    bus, clock = InProcessBus(), SteppedClock(START_NS)
    motion, force = relay.RelayedMotion(bus, clock=clock), relay.RelayedForce(bus, clock=clock)
    with closing(bus), closing(motion), closing(force):
        forces = bus.subscribe('/force_distribution', topics.FORCE_DISTRIBUTION.type_name, Qos('queue', 10))
        picture = conversions.image_message(np.zeros((4, 4), np.uint8), conversions.header(START_NS + 7, 'camera'))
        bus.advertise('/image_raw', topics.IMAGE.type_name, Qos('newest')).publish(picture)
        for node in (motion, motion, force, force):
            node.spin_once()
        published = forces.take()
    assert published is not None
    assert (stamp_ns(published.message.header.stamp), published.message.total) == (START_NS + 7, 1.5)


def test_a_relay_takes_the_place_of_motion_and_force_in_the_live_launch(tmp_path: Path) -> None:
    launch = yaml.safe_load(relay.relayed(tmp_path).read_text())
    whole = yaml.safe_load((paths.share_directory() / 'launch/live.launch.yaml').read_text())

    def programs(document: dict[str, Any]) -> list[str]:
        group = next(each['group'] for each in document['launch'] if 'group' in each)
        return [each['node']['exec'] for each in group if 'node' in each]

    assert [relay.PROGRAM if name == 'composed_node' else name for name in programs(whole)] == programs(launch)
    with relay.relaying(tmp_path):
        (word,) = command_of(relay.PACKAGE, relay.PROGRAM, os.environ)
    assert word == str(tmp_path / 'lib' / relay.PACKAGE / relay.PROGRAM)


def test_the_page_says_how_far_over_the_relay_sensing_is() -> None:
    runs = [{**LIVE, 'arrangement': name, 'p99_ms': p99} for name, p99 in ((latency.RELAY, 2.25), ('one process', 3.0))]
    assert '|             0.75 |' in latency._live_table(runs)
