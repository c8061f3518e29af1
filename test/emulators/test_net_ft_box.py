"""The emulated Net F/T box, fed with requests and times by hand: what the manual says, byte for byte."""

from __future__ import annotations

import re
import struct

import pytest

from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.net_ft_box import NetFtBox
from tactile_nodes.emulators.force_torque.net_ft_config import NetFtConfig, xml
from tactile_nodes.emulators.world import UpsideDown

HERE, THERE = ('127.0.0.1', 5000), ('127.0.0.1', 6000)
START, START_TWO = bytes.fromhex('1234000200000000'), bytes.fromhex('1234000200000002')
STOP = bytes.fromhex('1234000000000000')
MS = 1_000_000


class Load:
    """A world that presses with one wrench."""

    def __init__(self, *wrench: float) -> None:
        self.wrench = wrench

    def wrench_at(self, time_ns: int) -> tuple[float, ...]:
        return self.wrench


def box_of(*wrench: float, **config: object) -> NetFtBox:
    return NetFtBox(Load(*(wrench or (0.0,) * 6)), NetFtConfig(**config))


def records(box: NetFtBox, now_ns: int) -> list[tuple[int, ...]]:
    return [struct.unpack('>3I6i', data) for data, _ in box.due(now_ns)]


def test_the_first_record_is_number_one_and_says_counts_big_endian() -> None:
    box = box_of(1.0, -1.0, 0.5, 0.0, 0.001, 0.0)
    box.request(START, HERE, 0)
    assert box.due(MS)[0] == (
        bytes.fromhex('00000001 00000001 00000000 000f4240 fff0bdc0 0007a120 00000000 000003e8 00000000'),
        HERE,
    )


def test_a_thousand_records_a_second_are_every_seventh_internal_sample() -> None:
    box = box_of()
    box.request(START, HERE, 0)
    found = records(box, 1000 * MS)
    assert [record[0] for record in found] == list(range(1, 1001))
    assert [record[1] for record in found] == list(range(1, 7000, 7))


def test_a_finite_count_is_sent_and_no_more() -> None:
    box = box_of()
    box.request(START_TWO, HERE, 0)
    assert len(records(box, 1000 * MS)) == 2
    assert box.client is None


def test_stop_stops() -> None:
    box = box_of()
    box.request(START, HERE, 0)
    box.request(STOP, HERE, 0)
    assert records(box, 1000 * MS) == []


def test_records_are_numbered_from_one_in_each_stream_and_samples_go_on() -> None:
    box = box_of()
    box.request(START, HERE, 0)
    last = records(box, 100 * MS)[-1]
    box.request(START, HERE, 100 * MS)
    first = records(box, 200 * MS)[0]
    assert first[0] == 1
    assert first[1] > last[1]


def test_whoever_asks_last_gets_the_records() -> None:
    box = box_of()
    box.request(START, HERE, 0)
    box.request(START, THERE, 0)
    assert {client for _, client in box.due(100 * MS)} == {THERE}


@pytest.mark.parametrize(
    'data', [b'', START[:7], START + b'x', b'\x12\x35' + START[2:], bytes.fromhex('1234009900000000')]
)
def test_what_is_no_request_is_ignored(data: bytes) -> None:
    box = box_of()
    box.request(data, HERE, 0)
    assert box.client is None


def test_beyond_the_range_bit_17_is_set_with_the_summary() -> None:
    box = box_of(0.0, 0.0, 121.0, 0.0, 0.0, 0.0)
    box.request(START, HERE, 0)
    assert records(box, MS)[0][2] == 0x8002_0000


def test_a_stalled_front_end_repeats_its_sample_while_records_go_on() -> None:
    box = box_of()
    box.request(START, HERE, 0)
    last = records(box, 10 * MS)[-1]
    box.faults.stalled = True
    stalled = records(box, 20 * MS)
    assert {record[1] for record in stalled} == {last[1]}
    assert stalled[0][0] == last[0] + 1


def test_its_clock_may_begin_anywhere_wrap_and_drift() -> None:
    """100 ppm too fast: 10 s are 70 007 samples."""
    box = NetFtBox(Load(*(0.0,) * 6), clock=DeviceClock(7000, 0, 2**32 - 8, drift_ppm=100))
    box.request(START, HERE, 0)
    found = [record[1] for record in records(box, 10_000 * MS)]
    assert found[:3] == [2**32 - 7, 0, 7]
    assert len(found) == 10_001


def test_the_page_has_every_field_that_clients_look_for() -> None:
    page = xml(NetFtConfig(), 0x8001_0000, (1, -2, 3, 4, 5, 6)).decode()
    fields = dict(re.findall(r'<(\w+)>([^<]*)</\1>', page))
    expected = {
        'runstat': '80010000', 'runft': '1;-2;3;4;5;6', 'runrate': '7000', 'cfgcpf': '1000000', 'cfgcpt': '1000000',
        'scfgfu': 'N', 'scfgtu': 'Nm', 'cfgmr': '40;40;120;2;2;2', 'setbias': '0;0;0;0;0;0', 'setuserfilter': '0',
        'comrdte': 'Enabled', 'comrdtrate': '1000',
    }  # fmt: skip
    assert expected.items() <= fields.items()
    others = 'setcfgsel cfgnam cfgcalsel cfgcalsn cfgtfx scfgtdu scfgtau mfgdigver'
    assert set(others.split()) <= fields.keys()


def test_axia_sensors_spell_the_rate_with_two_m() -> None:
    page = xml(NetFtConfig(axia=True), 0, (0,) * 6)
    assert b'<commrdtrate>1000</commrdtrate>' in page
    assert b'<comrdtrate>' not in page


def test_a_sensor_that_hangs_upside_down_reads_turned_forces() -> None:
    mounted = UpsideDown(Load(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert mounted.wrench_at(0) == (1.0, -2.0, -3.0, 4.0, -5.0, -6.0)
