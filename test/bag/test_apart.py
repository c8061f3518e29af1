"""How far apart the pictures of several sensors lie in one bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bagging import FORCE, START_NS, force

from tactile_nodes.bag.apart import pictures_apart
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter

MS = 1_000_000
NAMES = ('/force_distribution', '/image_raw')


def bag(folder: Path, stamps_ms: dict[str, list[float]]) -> BagReader:
    """Forces of sensors, by namespace, captured at these times and received in order of them."""
    writer = BagWriter(folder)
    for sensor in stamps_ms:
        writer.add_topic(BagTopic.of_type(f'{sensor}/force_distribution', FORCE, depth=1))
    sent = sorted((at, sensor) for sensor, stamps in stamps_ms.items() for at in stamps)
    for number, (at, sensor) in enumerate(sent):
        stamp = START_NS + round(at * MS)
        writer.write(f'{sensor}/force_distribution', force(number, stamp), stamp + MS, stamp, number)
    writer.close()
    return BagReader(folder)


def test_the_pictures_of_two_sensors_are_as_far_apart_as_they_were_captured(tmp_path: Path) -> None:
    with bag(tmp_path / 'two', {'/left': [0, 20, 40], '/right': [3, 24, 41]}) as two:
        found = pictures_apart(two, NAMES)
    assert found is not None
    assert found.sensors == ('/left', '/right')
    assert (found.median_s, found.largest_s) == pytest.approx((0.003, 0.004))
    assert (found.count, found.alone) == (3, 0)
    assert str(found) == '2 (/left, /right), pictures 3.0 ms apart (median), 4.0 ms at most'


def test_pictures_that_one_sensor_lost_are_counted(tmp_path: Path) -> None:
    """Of three sensors the first and the last of a group lie 5 ms apart; one has no picture at 40 ms."""
    stamps = {'/a': [0.0, 20, 40, 60, 80], '/b': [5.0, 25, 65, 85], '/c': [2.0, 22, 42, 62, 82]}
    with bag(tmp_path / 'three', stamps) as three:
        found = pictures_apart(three, NAMES)
    assert found is not None
    assert (found.median_s, found.largest_s, found.alone) == pytest.approx((0.005, 0.017, 1))  # 25 ms, and 42
    assert '1 of 5 have none within half a frame time' in str(found)


@pytest.mark.parametrize('stamps', [{'': [0.0, 20]}, {'/left': [0.0, 20]}, {'/left': [0.0, 20], '/right': []}])
def test_of_one_sensor_nothing_is_reported(tmp_path: Path, stamps: dict[str, list[float]]) -> None:
    with bag(tmp_path / 'one', stamps) as one:
        assert pictures_apart(one, NAMES) is None


@pytest.mark.parametrize('count', [1, 2, 7])
def test_any_number_of_pictures_is_compared(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(count)
    left = np.sort(rng.uniform(0, 100, count))
    right = np.sort(rng.uniform(0, 100, 3))
    with bag(tmp_path / 'some', {'/left': left.tolist(), '/right': right.tolist()}) as some:
        found = pictures_apart(some, NAMES)
    assert found is not None
    expected = np.abs(left[:, None] - right).min(axis=1)
    assert found.largest_s == pytest.approx(1e-3 * expected.max(), abs=1e-8)


def test_the_last_capture_of_each_sensor_is_found_however_early_it_was(tmp_path: Path) -> None:
    """Of 10 min: to the end, 30 s before it, and in the first second alone."""
    stamps = {'/left': [0.0, 600_000], '/right': [0.0, 570_000], '/thumb': [10.0, 500]}
    with bag(tmp_path / 'long', stamps) as long:
        found = long.newest_stamps_ns([f'/{name}/force_distribution' for name in ('left', 'right', 'thumb', 'index')])
    assert {topic.split('/')[1]: (stamp - START_NS) / MS for topic, stamp in found.items()} == {
        'left': 600_000, 'right': 570_000, 'thumb': 500
    }  # fmt: skip
