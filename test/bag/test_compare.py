"""Comparing two recordings bit for bit."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from bagging import START_NS, STEP_NS, Sample, force, samples, write

from tactile_nodes.bag.compare import Comparison, _compare_one, compare
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bag.writer import BagWriter
from tactile_nodes.errors import BagError
from tactile_nodes.messages import types


def compared(tmp_path: Path, first: list[bytes], second: list[bytes], **options) -> Comparison:
    for name, content in (('a', first), ('b', second)):
        write(tmp_path / name, [Sample('/force', START_NS + number, data) for number, data in enumerate(content)])
    with BagReader(tmp_path / 'a') as one, BagReader(tmp_path / 'b') as other:
        return compare(one, other, 'force', **options)


def forces(count: int, **fields) -> list[bytes]:
    return [force(number, START_NS + number * STEP_NS, **fields) for number in range(count)]


def test_equal_recordings_are_bit_identical(tmp_path: Path) -> None:
    found = compared(tmp_path, forces(6), forces(6))
    assert found.same
    assert found.lines() == ['6 of 6 common stamps bit-identical']


def test_one_bit_in_one_bin_is_found(tmp_path: Path) -> None:
    other = np.linspace(0, 2, 81, dtype=np.float32)
    other[40] = np.nextafter(other[40], np.float32(2))
    changed = forces(6)
    changed[2] = force(2, START_NS + 2 * STEP_NS, normal_force=other)
    found = compared(tmp_path, forces(6), changed)
    assert not found.same
    assert found.lines()[0] == '5 of 6 common stamps bit-identical'
    assert found.fields == {'normal_force': 1}
    assert found.largest == 2.0**-23  # one unit in the last place of a float32 in [1, 2)


def test_minus_zero_differs_and_nan_equals_itself(tmp_path: Path) -> None:
    nan = types.Point(x=math.nan)
    found = compared(tmp_path, forces(1, contact=nan, total=0.0), forces(1, contact=nan, total=-0.0))
    assert found.fields == {'total': 1}


def test_stage_times_may_differ(tmp_path: Path) -> None:
    found = compared(tmp_path, forces(2), forces(2, stages=types.StageTimes(flow=0.004)))
    assert found.same


def test_texts_are_reported_but_do_not_count(tmp_path: Path) -> None:
    found = compared(tmp_path, forces(2), forces(2, provenance=types.Provenance(model='other')))
    assert found.same
    assert 'strings that differ: provenance.model (2)' in found.lines()


def test_texts_of_one_side_only_do_not_count_either(tmp_path: Path) -> None:
    for one, other in ((['left'], []), ([], ['left'])):
        found = Comparison()
        _compare_one(types.HandWrench(missing=one), types.HandWrench(missing=other), (), found)
        assert (found.identical, found.fields, found.texts) == (1, {}, {'missing[0]': 1})


def test_stamps_of_one_side_only_are_counted(tmp_path: Path) -> None:
    found = compared(tmp_path, forces(6), forces(8)[2:])
    assert (found.common, found.only_first, found.only_second) == (4, 2, 2)
    assert found.same


def test_long_recordings_are_compared_without_being_held_in_memory(tmp_path: Path) -> None:
    values = np.zeros(200_000, np.float32)
    content = [force(number, START_NS + number * STEP_NS, normal_force=values) for number in range(60)]
    for name, part in (('a', content[5:]), ('b', content[:-5])):
        write(tmp_path / name, [Sample('/force', START_NS + number, data) for number, data in enumerate(part)])
    with BagReader(tmp_path / 'a') as one, BagReader(tmp_path / 'b') as other:
        tracemalloc.start()
        assert compare(one, other, 'force').common == 50
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 55 * values.nbytes  # one bag


def test_nothing_in_common_is_not_the_same(tmp_path: Path) -> None:
    assert not compared(tmp_path, forces(2), [force(0, 1)]).same


def test_topic_that_is_not_there_is_an_error_that_names_those_that_are(bag: Path) -> None:
    with BagReader(bag) as reader, pytest.raises(BagError, match='/force, /text'):
        compare(reader, reader, 'wrench')


def test_a_bag_without_topics_is_an_error_that_says_so(tmp_path: Path) -> None:
    BagWriter(tmp_path / 'empty').close()
    with BagReader(tmp_path / 'empty') as reader, pytest.raises(BagError, match=r'none; it has no topics$'):
        compare(reader, reader, 'force')


def test_topic_without_stamps_is_an_error(tmp_path: Path) -> None:
    write(tmp_path / 'press', samples(4))
    with BagReader(tmp_path / 'press') as reader, pytest.raises(BagError, match='no message with a stamp'):
        compare(reader, reader, '/text')
