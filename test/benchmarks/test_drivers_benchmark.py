"""The benchmark of the drivers runs and reports; how fast they are depends on the machine, and is nothing to assert."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import drivers
from benchmarks.drivers.devices import PICTURES
from benchmarks.drivers.meter import Durations, Meter, Order
from benchmarks.drivers.readers import Flicker, Traffic
from tactile_nodes.cli import bench
from tactile_nodes.clock import SteppedClock, SystemClock

IN_PROCESSES = ['text', 'sync']
HERE = [name for name in drivers.CASES if name not in (*IN_PROCESSES, 'camera_60')]
"""The flood is of the same driver and device as the camera at 60 pictures a second."""


def require_measured(entry: dict[str, Any]) -> None:
    assert entry['received'] > 0
    assert entry['latency_ms']['p50'] <= entry['latency_ms']['p99']
    assert entry['memory_mb']['end'] > 0


def test_devices_and_drivers_are_measured_side_by_side_in_processes_of_their_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    chosen = ['drivers', '--seconds', '0.3', '--together', '2', '--only', *IN_PROCESSES]
    assert bench.run(parser.parse_args([*chosen, '-o', str(tmp_path / 'drivers.json')])) == 0
    printed = capsys.readouterr().out
    found = json.loads((tmp_path / 'drivers.json').read_text())['drivers']
    assert set(found) == set(IN_PROCESSES)
    for name, entry in found.items():
        require_measured(entry)
        assert drivers.CASES[name].title in printed


@pytest.mark.parametrize('name', HERE)
def test_every_driver_is_measured_against_its_device(name: str, tmp_path: Path) -> None:
    case, stamps, meter = drivers.CASES[name], np.zeros(1 + PICTURES, np.int64), Meter(SystemClock(), 0.3)
    assert case.device is not None
    with case.device(tmp_path, stamps) as address:
        case.reader({**address, 'seconds': drivers.MARGIN_S}, stamps, meter)
    require_measured(meter.result())


def test_durations_are_summed_up_to_one_percent_and_the_worst_exactly() -> None:
    durations = Durations()
    durations.add([1_000_000] * 98 + [5_000_000, 7_654_321])
    summary = durations.summary_ms()
    assert summary['p50'] == pytest.approx(1.0, rel=0.01)
    assert summary['p99'] == pytest.approx(5.0, rel=0.01)
    assert summary['worst'] == 7.654321
    assert Durations().summary_ms() == {}


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock(1)


@pytest.fixture
def meter(clock: SteppedClock) -> Meter:
    """One that warms up for a moment, and then measures for 10 s."""
    made = Meter(clock, 10.0)
    made.going_on()
    return made


def test_lost_doubled_and_reordered_are_reported_by_the_numbers(clock: SteppedClock, meter: Meter) -> None:
    clock.advance(0.5)
    meter.going_on()
    Order(meter).follow([1, 2, 4, 4, 3, 5])
    clock.advance(1.0)
    result = meter.result()
    assert (result['lost'], result['doubled'], result['reordered']) == (1, 1, 1)


def test_nothing_counts_while_a_run_warms_up(meter: Meter) -> None:
    meter.handed_over([5])
    meter.count('lost')
    assert not meter.measuring
    assert meter.latency.summary_ms() == {}


def test_a_run_whose_warm_up_is_held_up_is_measured_for_as_long_as_any(clock: SteppedClock, meter: Meter) -> None:
    clock.advance(20.0)
    assert meter.going_on()
    clock.advance(9.9)
    assert meter.going_on()
    clock.advance(0.2)
    assert not meter.going_on()


def test_answers_are_counted_however_the_bytes_arrive() -> None:
    traffic = Traffic()
    traffic.hear('>', 0, b'?')
    traffic.hear('>', 0, b'G1 X1\n')
    for piece in (b'<Idle|MPos:0,0,0>\r', b'\no', b'k\r\n'):
        traffic.hear('<', 0, piece)
    assert traffic.unanswered() == 0


def test_a_flickering_line_changes_at_its_times_alone() -> None:
    flicker = Flicker(0, 1.0)
    first, second = flicker.times_ns[:2]
    levels = [flicker.line_level(time_ns) for time_ns in (first - 1, first, second - 1, second)]
    assert levels == [False, True, True, False]
