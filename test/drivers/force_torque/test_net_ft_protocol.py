"""RDT byte for byte, its sequence numbers, the status word, and the box's own page."""

from __future__ import annotations

import math

import pytest

from tactile_nodes.drivers.force_torque import net_ft_rdt as rdt
from tactile_nodes.drivers.force_torque.contract import Flag
from tactile_nodes.drivers.force_torque.net_ft_config import parse_config
from tactile_nodes.drivers.force_torque.net_ft_rdt import Record, StreamTracker, flags_of
from tactile_nodes.errors import DeviceError

# As a box of firmware 2.2.59 with a Gamma answers, shortened.
GAMMA = b"""<?xml version="1.0" encoding="UTF-8"?>
<netft><runstat>0</runstat><runft>0;0;0;0;0;0</runft><runrate>7000</runrate>
<cfgcalsn>FT12345</cfgcalsn><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt>
<cfgmr>130;130;400;10;10;10</cfgmr><comrdte>Enabled</comrdte><comrdtrate>1000</comrdtrate></netft>"""


def page(**fields: object) -> bytes:
    given = {'scfgfu': 'N', 'scfgtu': 'Nm', 'cfgcpf': 1000000, 'cfgcpt': 1000000, **fields}
    return ('<netft>' + ''.join(f'<{name}>{value}</{name}>' for name, value in given.items()) + '</netft>').encode()


def record(rdt_sequence: int, ft_sequence: int | None = None) -> Record:
    return Record(rdt_sequence, 7 * rdt_sequence if ft_sequence is None else ft_sequence, 0, (0,) * 6)


def accepted(tracker: StreamTracker, *records: Record) -> list[int | None]:
    """How many are missing before each; None for those that are dropped."""
    found = [tracker.accept(each) for each in records]
    return [None if each is None else each.missing for each in found]


@pytest.mark.parametrize(
    ('command', 'count', 'expected'),
    [
        (rdt.STOP, 0, '1234 0000 00000000'),
        (rdt.START_REALTIME, 0, '1234 0002 00000000'),
        (rdt.START_REALTIME, 10_000, '1234 0002 00002710'),
    ],
)
def test_a_request_is_eight_bytes_big_endian(command: int, count: int, expected: str) -> None:
    assert rdt.request(command, count) == bytes.fromhex(expected)


def test_a_record_is_three_unsigned_and_six_signed_numbers_big_endian() -> None:
    data = bytes.fromhex('00000001 fffffff0 80010000 000f4240 fff0bdc0 00000000 7fffffff 80000000 ffffffff')
    counts = (1_000_000, -1_000_000, 0, 2**31 - 1, -(2**31), -1)
    assert rdt.record_in(data) == Record(1, 2**32 - 16, 0x8001_0000, counts)


@pytest.mark.parametrize('size', [0, 1, 35, 37, 72])
def test_a_datagram_that_is_no_record_is_none(size: int) -> None:
    assert rdt.record_in(bytes(size)) is None


WRAPPED = [record(2**32 - 2, 2**32 - 10), record(2**32 - 1, 2**32 - 3), record(0, 4), record(2, 18)]


@pytest.mark.parametrize(
    ('records', 'missing', 'lost', 'duplicates', 'late'),
    [
        pytest.param([record(1), record(2), record(6)], [0, 0, 3], 3, 0, 0, id='a gap'),
        pytest.param([record(1), record(2), record(2), record(3)], [0, 0, None, 0], 0, 1, 0, id='one comes twice'),
        pytest.param([record(1), record(3), record(2), record(4)], [0, 1, None, 0], 1, 0, 1, id='one comes late'),
        pytest.param(WRAPPED, [0, 0, 0, 1], 1, 0, 0, id='both counters wrap'),
    ],
)
def test_records_that_are_lost_come_twice_or_late_are_counted(
    records: list[Record], missing: list[int | None], lost: int, duplicates: int, late: int
) -> None:
    tracker = StreamTracker()
    assert accepted(tracker, *records) == missing
    counters = tracker.counters
    assert (counters.lost, counters.duplicates, counters.out_of_order) == (lost, duplicates, late)


@pytest.mark.parametrize(
    ('old', 'new', 'missing'),
    [
        pytest.param(500, [record(1, 3507), record(2, 3514)], [0, 0], id='it counts from one'),
        pytest.param(500, [record(2, 3528)], [3], id='three records of 7 ticks are lost'),  # from 3500 to 3528
        pytest.param(501, [record(500, 3500), record(1, 3514)], [None, 0], id='a late one of the old stream'),
        pytest.param(500, [record(501, 3507), record(1, 3514)], [0, 0], id='the old stream goes on at first'),
    ],
)
def test_a_renewed_stream_loses_nothing_uncounted(old: int, new: list[Record], missing: list[int | None]) -> None:
    tracker = StreamTracker()
    accepted(tracker, record(499), record(old))
    tracker.requested()
    assert accepted(tracker, *new) == missing
    assert tracker.renewed


def test_a_second_request_that_was_not_needed_begins_once_more_and_loses_nothing() -> None:
    """The host was held up, and asked again before it read that the box had begun: two streams follow."""
    tracker = StreamTracker()
    accepted(tracker, *(record(500 + n, 3500 + 7 * n) for n in range(3)))
    tracker.requested()
    tracker.requested()
    first = [record(1 + n, 3521 + 7 * n) for n in range(100)]
    second = [record(1 + n, 4221 + 7 * n) for n in range(200)]
    assert accepted(tracker, *first, *second) == [0] * 300
    assert (tracker.step, tracker.counters.lost, tracker.counters.out_of_order) == (7, 0, 0)


def test_one_odd_step_of_the_internal_counter_does_not_change_the_rate() -> None:
    tracker = StreamTracker()
    accepted(tracker, record(1, 7), record(2, 14), record(3, 21), record(4, 4900), record(5, 4907))
    assert tracker.step == 7


def test_an_internal_counter_that_stands_still_is_a_stalled_front_end() -> None:
    tracker = StreamTracker()
    results = [tracker.accept(each) for each in (record(1, 7), record(2, 14), record(3, 14))]
    assert [each.stalled for each in results if each] == [False, False, True]


def test_an_internal_counter_that_begins_again_is_a_box_that_was_restarted() -> None:
    tracker = StreamTracker()
    accepted(tracker, record(4999, 700_000), record(5000, 700_007))
    tracker.requested()
    result = tracker.accept(record(1, 350))
    assert result is not None
    assert result.rebooted


@pytest.mark.parametrize(
    ('status', 'flags'),
    [(0, 0), (0x8001_0000, Flag.THRESHOLD), (0x8002_0000, Flag.SATURATED | Flag.FAULT)],
    ids=['well', 'the threshold latch alone', 'saturated'],
)
def test_bits_of_the_status_have_their_meaning(status: int, flags: int) -> None:
    assert flags_of(status) == flags


@pytest.mark.parametrize('bit', [bit for bit in range(32) if bit not in {16, 31}])
def test_every_other_bit_is_a_fault_also_those_that_have_no_name(bit: int) -> None:
    assert flags_of(1 << 31 | 1 << bit) & Flag.FAULT


def test_the_configuration_of_a_real_box_is_read() -> None:
    config = parse_config(GAMMA, 'box')
    assert config.units_per_count == (1e-6,) * 6
    assert (config.rate_hz, config.enabled, config.axia) == (1000.0, True, False)
    assert config.fields['cfgcalsn'] == 'FT12345'


def test_an_axia_sensor_spells_its_rate_differently_and_rdt_may_be_switched_off() -> None:
    config = parse_config(page(commrdtrate=500), 'box')
    assert (config.rate_hz, config.axia) == (500.0, True)
    assert not parse_config(page(comrdte='Disabled'), 'box').enabled


FORCES = {
    'N': 1, 'kN': 1000, '2': 1, 'lbf': 4.4482216, 'klbf': 4448.2216, 'kgf': 9.80665, 'kg': 9.80665, 'gf': 0.00980665,
}  # fmt: skip
TORQUES = {
    'Nm': 1, 'N-m': 1, 'N·m': 1, 'Nmm': 1e-3, 'N-mm': 1e-3, 'kg-cm': 0.0980665, 'kgf-cm': 0.0980665, '3': 1,
    'lbf-in': 0.11298483, 'in-lbf': 0.11298483, 'lbf-ft': 1.3558179, 'kNm': 1000, 'kN-m': 1000,
}  # fmt: skip


@pytest.mark.parametrize(
    ('fields', 'axis', 'units'),
    [
        *(({'scfgfu': unit, 'cfgcpf': 10}, 2, newtons / 10) for unit, newtons in FORCES.items()),
        *(({'scfgtu': unit, 'cfgcpt': 100}, 5, newton_metres / 100) for unit, newton_metres in TORQUES.items()),
    ],
)
def test_units_become_newtons_and_newton_metres(fields: dict[str, object], axis: int, units: float) -> None:
    config = parse_config(page(**fields), 'box')
    assert math.isclose(config.units_per_count[axis], units, rel_tol=1e-7)


@pytest.mark.parametrize('field', ['scfgfu', 'scfgtu', 'cfgcpf', 'cfgcpt'])
@pytest.mark.parametrize('value', ['', 'furlong', '0', '-5', 'nan'])
def test_a_box_whose_counts_mean_nothing_is_refused_by_name(field: str, value: str) -> None:
    with pytest.raises(DeviceError, match=field):
        parse_config(page(**{field: value}), 'box')


def test_a_page_of_something_else_is_refused() -> None:
    with pytest.raises(DeviceError, match='not that of a Net F/T box'):
        parse_config(b'<html>a printer</html>', 'box')
