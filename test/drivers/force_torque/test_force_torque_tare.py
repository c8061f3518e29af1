"""Zeroing on the host."""

from __future__ import annotations

import json
import math

import pytest

from tactile_nodes.drivers.force_torque.contract import Flag, Sample
from tactile_nodes.drivers.force_torque.tare import tare
from tactile_nodes.errors import DeviceError


def samples(count: int = 51, fz: float = 2.0, slope: float = 0.0, flags: int = 0, dropped: int = 0) -> list[Sample]:
    """100 a second; Fz swings by 0.1 N, so its standard deviation is 0.1 N, and drifts by `slope` N per sample."""
    return [
        Sample(
            (0.5, math.nan, fz + 0.1 * (-1) ** n + slope * n, 0.01, 0.02, 0.03),
            n * 10_000_000, n * 10_000_000, n, n + dropped * (n > 0), dropped * (n > 0), flags * (n == 7), 0,
            (5, 1000 + n % 2),
        )
        for n in range(count)
    ]  # fmt: skip


def test_the_tare_is_the_mean_with_its_deviation() -> None:
    """Of 50 swings of 0.1 N: mean 2 N, deviation 0.1 N; of the raw counts 1000 and 1001, 1000.5."""
    zero = tare(samples(50))
    assert zero.wrench[2] == pytest.approx(2.0)
    assert zero.deviation[2] == pytest.approx(0.1)
    assert zero.raw == pytest.approx((5, 1000.5))
    assert (zero.samples, zero.start_ns, zero.end_ns) == (50, 0, 490_000_000)


def test_it_can_be_recorded() -> None:
    record = tare(samples(50)).record()
    assert json.loads(json.dumps(record))['samples'] == 50


def test_less_than_half_a_second_is_refused() -> None:
    with pytest.raises(DeviceError, match=r'49 samples over 0\.48 s'):
        tare(samples(49))


@pytest.mark.parametrize('count', [0, 1, 3])
def test_next_to_nothing_is_refused(count: int) -> None:
    with pytest.raises(DeviceError, match='are needed'):
        tare(samples(count))


@pytest.mark.parametrize('flag', [Flag.FAULT, Flag.SATURATED, Flag.STALLED])
def test_one_faulty_sample_is_refused(flag: Flag) -> None:
    with pytest.raises(DeviceError, match='1 of 51 samples are faulty'):
        tare(samples(flags=flag))


def test_a_sensor_that_is_being_touched_is_refused() -> None:
    """4 mN a sample: the halves of 51 samples differ by 0.1 N."""
    with pytest.raises(DeviceError, match='not at rest'):
        tare(samples(slope=0.004))


def test_too_many_lost_samples_are_refused() -> None:
    with pytest.raises(DeviceError, match='6 samples were lost'):
        tare(samples(dropped=6))
