"""The thread that reads a device and opens it again, with a device and waits that the test scripts."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from types import SimpleNamespace

import pytest

from tactile_nodes.drivers import reopening
from tactile_nodes.drivers.reopening import Reopening
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceNotFoundError, ImageError, TactileError

GONE, AWAY = DeviceLostError('X is gone'), DeviceNotFoundError('there is no X')


class Device:
    """A device that gives what it is set to: whether there are data, or an error; in the end it waits."""

    def __init__(self, answers: Iterable[bool | Exception]) -> None:
        self.answers = list(answers)
        self.closed_by = ''

    def close(self) -> None:
        self.closed_by = threading.current_thread().name


class Bench:
    """Devices that are opened one after another; a wait takes no time, and is noted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *devices: Device | TactileError) -> None:
        self.left = list(devices)
        self.waited: list[float] = []
        self.reasons: list[TactileError] = []
        self.at_end = threading.Event()
        self.source = Reopening('X', self.connect, self.fetch, self.lose)
        bench = self

        class Noting(threading.Event):
            def wait(self, timeout: float | None = None) -> bool:
                bench.waited.append(timeout or 0.0)
                return self.is_set()

        monkeypatch.setattr(reopening, 'threading', SimpleNamespace(Event=Noting, Thread=threading.Thread))

    def lose(self, error: TactileError) -> None:
        self.reasons.append(error)
        if not isinstance(error, DeviceError):
            self.at_end.set()

    def connect(self) -> Device:
        answer = self.left.pop(0)
        if isinstance(answer, TactileError):
            raise answer
        return answer

    def fetch(self, device: Device) -> bool:
        if not device.answers:
            self.source.stop()
            self.at_end.set()
            return False
        answer = device.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def run(self) -> None:
        self.source.open()
        assert self.at_end.wait(30)
        self.source.close(30.0)


def test_a_device_that_was_never_there_is_an_error_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, AWAY)
    with pytest.raises(DeviceNotFoundError):
        bench.source.open()
    assert not bench.source.is_open


def test_attempts_wait_twice_as_long_each_time_up_to_five_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, Device([True, GONE]), *[AWAY] * 7, Device([]))
    bench.run()
    assert bench.waited == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0]
    assert bench.reasons == [GONE, *[AWAY] * 7]


def test_the_delays_start_over_only_after_data(monkeypatch: pytest.MonkeyPatch) -> None:
    silent, well = [False, GONE], [True, GONE]
    bench = Bench(monkeypatch, *(Device(each) for each in (well, silent, silent, well, silent, [])))
    bench.run()
    assert bench.waited == [0.25, 0.5, 1.0, 0.25, 0.5]
    assert bench.source.losses == 2


def test_an_error_of_the_system_is_a_loss_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, Device([True, OSError(5, 'Input/output error')]), Device([]))
    bench.run()
    assert [str(reason) for reason in bench.reasons] == ['[Errno 5] Input/output error']
    assert bench.source.losses == 1


def test_the_thread_closes_each_device_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not whoever stops it: a handle closed under a running read crashes in the libraries below."""
    first, second = Device([True, GONE]), Device([])
    Bench(monkeypatch, first, second).run()
    assert first.closed_by == second.closed_by == 'X'


def test_an_error_that_opening_again_cannot_mend_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = ImageError('X gives pictures of 1x1')
    bench = Bench(monkeypatch, Device([True, GONE]), Device([wrong]))
    bench.run()
    assert bench.reasons == [GONE, wrong]


def test_closing_does_not_wait_for_a_device_that_hangs_which_is_closed_when_it_wakes() -> None:
    begun, hanging, device = threading.Event(), threading.Event(), Device([])

    def hang(_: Device) -> bool:
        begun.set()
        return hanging.wait(120)

    source = Reopening('X', lambda: device, hang, lambda _: None)
    source.open()
    assert begun.wait(30)
    (thread,) = (each for each in threading.enumerate() if each.name == 'X')
    source.close(0.05)
    assert device.closed_by == ''
    hanging.set()
    thread.join(30)
    assert device.closed_by == 'X'
