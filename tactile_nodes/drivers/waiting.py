"""Waits for a device that was just switched on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import DeviceError

Device = TypeVar('Device')
PERIOD_NS = NS_PER_S // 4


def opened_within(
    wait_s: float,
    open_device: Callable[[], Device],
    clock: Clock,
    on_failure: Callable[[DeviceError], None],
    worth_waiting: tuple[type[DeviceError], ...] = (DeviceError,),
) -> Device:
    """The result of `open_device`, tried four times per second; `on_failure` is called with each failure.

    Raises:
        DeviceError: it cannot be opened within `wait_s`, or for a reason that waiting does not fix.
    """
    deadline_ns = clock.now_ns() + round(wait_s * NS_PER_S)
    while True:
        try:
            return open_device()
        except worth_waiting as error:
            if clock.now_ns() >= deadline_ns:
                raise
            on_failure(error)
        clock.sleep_until(clock.now_ns() + PERIOD_NS)
