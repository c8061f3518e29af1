"""Waiting for a device that was just switched on, on a clock that passes only by being slept through."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tactile_nodes.clock import NS_PER_S, SteppedClock
from tactile_nodes.drivers.waiting import opened_within
from tactile_nodes.errors import DeviceError, DeviceFaultError, DeviceNotFoundError

ABSENT, FAULTY = DeviceNotFoundError('there is no rig'), DeviceFaultError('the rig is in alarm')


def switched_on_after(seconds: float, clock: SteppedClock, refusal: DeviceError = ABSENT) -> Callable[[], str]:
    begin_ns = clock.now_ns()

    def opening() -> str:
        if clock.now_ns() - begin_ns < seconds * NS_PER_S:
            raise refusal
        return 'the rig'

    return opening


def test_a_device_that_is_switched_on_meanwhile_is_opened_and_every_failure_reported(jumping: SteppedClock) -> None:
    failures: list[DeviceError] = []
    assert opened_within(2.0, switched_on_after(1.0, jumping), jumping, failures.append) == 'the rig'
    assert failures == [ABSENT] * 4  # at 0, 0.25, 0.5 and 0.75 s


def test_a_device_that_does_not_come_is_the_callers_error_when_the_time_is_over(jumping: SteppedClock) -> None:
    begin_ns = jumping.now_ns()
    with pytest.raises(DeviceNotFoundError, match='no rig'):
        opened_within(2.0, switched_on_after(9.0, jumping), jumping, lambda _: None)
    assert jumping.now_ns() - begin_ns == 2 * NS_PER_S


def test_what_waiting_does_not_mend_is_reported_at_once(jumping: SteppedClock) -> None:
    begin_ns = jumping.now_ns()
    opening = switched_on_after(1.0, jumping, FAULTY)
    with pytest.raises(DeviceFaultError):
        opened_within(2.0, opening, jumping, lambda _: None, (DeviceNotFoundError,))
    assert jumping.now_ns() == begin_ns
