"""What the sensor itself said, as it comes into a bag."""

from __future__ import annotations

import pytest

from tactile_nodes import messages
from tactile_nodes.collection.run.run_messages import Batch, counts_message
from tactile_nodes.drivers.force_torque.contract import Flag, Sample
from tactile_nodes.messages import types

MS = 1_000_000
START_NS = 1_795_000_000_000_000_000


def sample(ms: int, sequence: int, flags: int = 0, status: int = 0) -> Sample:
    raw = (ms, -2, 3, -4, 5, 2**31 - 1)
    stamp_ns = START_NS + ms * MS
    return Sample((0.0,) * 6, stamp_ns, stamp_ns + 2 * MS, 2**32 + ms, sequence, 0, flags, status, raw)


def test_counts_status_and_numbers_come_out_of_the_bytes_as_they_were_sent() -> None:
    samples = [sample(0, 17), sample(1, 19, Flag.THRESHOLD, 0x8001_0000)]
    data = messages.encode(counts_message(samples, 'force_torque_sensor', 'netft://192.168.1.1'))
    message = messages.decode(data, 'tactile_nodes/msg/ForceTorqueCounts')
    assert messages.stamp_ns(message.header.stamp) == START_NS
    assert (message.header.frame_id, message.source, message.channels) == (
        'force_torque_sensor',
        'netft://192.168.1.1',
        6,
    )
    assert message.measured.tolist() == [0, MS]
    assert message.arrived.tolist() == [2 * MS, 3 * MS]
    assert message.sequence.tolist() == [17, 19]
    assert message.ticks.tolist() == [2**32, 2**32 + 1]
    assert message.status.tolist() == [0, 0x8001_0000]
    assert message.flags.tolist() == [0, types.ForceTorqueCounts.FLAG_THRESHOLD]
    assert message.counts.reshape(-1, 6).tolist() == [[0, -2, 3, -4, 5, 2**31 - 1], [1, -2, 3, -4, 5, 2**31 - 1]]


@pytest.mark.parametrize('flag', list(Flag))
def test_the_message_names_every_flag_of_the_drivers(flag: Flag) -> None:
    assert getattr(types.ForceTorqueCounts, f'FLAG_{flag.name}') == flag


def test_every_sample_is_in_one_batch_of_a_tenth_of_a_second() -> None:
    batch = Batch()
    given = [sample(ms, ms) for ms in range(250)]
    batches = [found for each in given if (found := batch.add(each))] + [batch.rest()]
    assert [len(found) for found in batches] == [100, 100, 50]
    assert [each for found in batches for each in found] == given
    assert not batch.rest()


def test_a_pause_of_the_sensor_or_a_clock_that_goes_back_begins_another_batch() -> None:
    batch = Batch()
    assert not batch.add(sample(0, 0))
    assert len(batch.add(sample(60_000, 1))) == 1
    assert len(batch.add(sample(59_999, 2))) == 1
