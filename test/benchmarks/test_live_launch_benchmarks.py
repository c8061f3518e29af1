"""Benchmarks on a live launch run and report; what they find depends on the machine, and is nothing to assert."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

from benchmarks import page
from benchmarks.endurance.live import watched
from benchmarks.page import Condition, Seen
from benchmarks.page.launch import Sensing
from benchmarks.system_faults import on_bus
from benchmarks.system_faults.bus import SPOILT
from benchmarks.system_faults.sensor import Sensor, sensor
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.learning.progress import Progress


@pytest.fixture(scope='module')
def sensed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sensor]:
    """A live launch, for all that is measured on one; with a sixth of the usual pictures."""
    with pytest.MonkeyPatch.context() as patch:
        module = sys.modules[sensor.__module__]
        patch.setattr(module, 'CONFIG', module.CONFIG.replace('fps: 60.0', 'fps: 10.0'))
        with sensor(tmp_path_factory.mktemp('live'), period_s=4.0) as sensed:
            yield sensed


@pytest.fixture
def running(sensed: Sensor) -> Iterator[Sensing]:
    """The same, as the benchmarks of page and endurance see it."""
    topic = topics.FORCE_DISTRIBUTION
    forces = sensed.bus.subscribe(f'/{topic.name}', topic.type_name, Qos('queue', 1000))
    yield Sensing(sensed.page, sensed.launch, sensed.bus, forces)
    forces.close()


def test_sensing_is_measured_under_viewers_of_whom_one_hangs(running: Sensing) -> None:
    condition = Condition('one, and one that hangs', viewers=1, hanging=1)
    found = page.measure_on(running, [condition], seconds=0.5, rounds=1, settle_s=0.25)
    result = page.summed_up(found[condition])
    assert result['frames'] > 0
    assert 0 < result['latency_ms']['p50'] <= result['latency_ms']['p99']
    assert result['shown_hz'] > 0
    assert set(result['cpu_percent']) == set(page.PROCESSES.values())
    assert condition.title in page.conditions_table({'conditions': {condition.title: result}})


def test_a_live_launch_is_looked_at_process_by_process(running: Sensing) -> None:
    part = watched(running, 0.5, 0.25, Progress())
    assert part['frames']['received'] > 0
    assert {'camera_node', 'composed_node', 'drift_monitor_node'} <= set(part['processes'])
    assert all(held['memory_mb']['last'] > 10 for held in part['processes'].values())


def test_random_messages_and_a_spoilt_folder_kill_no_process(sensed: Sensor) -> None:
    part = on_bus(sensed, 20, list(SPOILT)[:1], 0.5)
    assert part['garbage']['died'] == part['garbage']['bugs'] == []
    assert part['garbage']['messages'] > 0
    assert [each['died'] for each in part['spoilt']] == [()]


def test_percentiles_are_over_all_frames_and_the_spread_is_over_rounds() -> None:
    rounds = [[1.0] * 10, [3.0] * 90]
    seen = Seen(rounds, cpu_percent={name: [10.0, 20.0] for name in page.PROCESSES.values()}, load=[0.5, 1.5])
    result = page.summed_up(seen)
    assert result['frames'] == 100
    assert result['latency_ms']['p50'] == pytest.approx(3.0)
    assert result['p50_of_rounds_ms'] == {'median': 2.0, 'low': 1.0, 'high': 3.0}
    assert result['cpu_percent']['camera'] == pytest.approx(15.0)


def test_each_round_begins_with_another_condition() -> None:
    conditions = [Condition(name) for name in 'abc']
    rounds = [''.join(each.title for each in page._turned(conditions, number)) for number in range(3)]
    assert rounds == ['abc', 'bca', 'cab']
