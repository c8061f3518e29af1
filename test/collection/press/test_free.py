"""Whether the tip is free above the gel."""

from __future__ import annotations

import pytest

from tactile_nodes.collection.actions import Observation
from tactile_nodes.collection.press.cycle import check_free
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import tare_of
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.errors import DeviceFaultError

S = 1_000_000_000
PLACE = (0.0, 0.0, 0.0)


def samples(force_n: float = 0.0) -> tuple[Sample, ...]:
    return tuple(Sample((0.0, 0.0, force_n, 0.0, 0.0, 0.0), at, at, 0, at, 0, 0, 0, ()) for at in range(10))


def test_sensor_that_pauses_is_waited_for() -> None:
    procedure = check_free(tare_of(samples()), CollectionSettings())
    next(procedure)
    look = procedure.send(Observation(S // 10, 0, PLACE))
    assert look.since_ns == 0  # from the beginning of the first look
    with pytest.raises(StopIteration):
        procedure.send(Observation(S // 5, 0, PLACE, samples()))


def test_computer_that_pauses_is_no_sensor_that_is_silent() -> None:
    procedure = check_free(tare_of(samples()), CollectionSettings())
    next(procedure)
    procedure.send(Observation(3 * S, 0, PLACE))  # all stood still for three seconds; samples are read after that
    with pytest.raises(StopIteration):
        procedure.send(Observation(3 * S + S // 10, 0, PLACE, samples()))


def test_tip_about_which_no_sample_tells_is_not_free() -> None:
    procedure = check_free(tare_of(samples()), CollectionSettings())
    next(procedure)
    with pytest.raises(DeviceFaultError, match='it is unknown'):
        for look in range(1, 31):
            procedure.send(Observation(look * S // 10, 0, PLACE))


def test_tip_on_which_a_force_is_left_is_not_free() -> None:
    procedure = check_free(tare_of(samples()), CollectionSettings())
    next(procedure)
    with pytest.raises(DeviceFaultError, match=r'0\.50 N remain'):
        procedure.send(Observation(S // 10, 0, PLACE, samples(0.5)))
