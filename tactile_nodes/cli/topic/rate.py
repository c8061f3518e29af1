"""``tactile topic hz``, ``bw`` and ``delay``: rate, bandwidth and delay."""

from __future__ import annotations

import argparse
import statistics
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import Verbs, completed, interruptible, joined, own_name, positive_int
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Received
    from tactile_nodes.clock import Clock

REPORT_EVERY_S = 1.0
Meter: TypeAlias = 'Rate | Delay | Bandwidth'


def add(verbs: Verbs) -> None:
    _add(verbs, 'hz', 10000, Rate, 'print the rate of incoming messages', '  tactile topic hz /image_raw\n')
    _add(verbs, 'bw', 100, Bandwidth, 'print the bandwidth of incoming messages', '  tactile topic bw /image_raw\n')
    example = '  tactile topic delay /force_distribution       capture of the image to here\n'
    _add(verbs, 'delay', 10000, Delay, "print the time from a message's stamp to its arrival", example)


def _add(verbs: Verbs, name: str, window: int, meter: Callable[[int], Meter], line: str, examples: str) -> None:
    verb = verbs.add(name, lambda arguments: measure(arguments, meter(arguments.window)), line, examples)
    completed(verb.add_argument('topic', help='a topic, /force_distribution for example'), completers.topics)
    window_help = f'messages to average over (default: {window})'
    verb.add_argument('-w', '--window', type=positive_int, default=window, metavar='N', help=window_help)


def measure(arguments: argparse.Namespace, meter: Meter) -> int:
    """Feed `meter` and print its report once a second, until interrupted."""
    from tactile_nodes.cli.topic.echo import awaited_type, queue_of

    topic = absolute(arguments.topic)
    with joined() as bus:
        type_name = awaited_type(bus, topic)
        subscription = bus.subscribe(topic, type_name, queue_of(topic), own_name())
        print(f'Subscribed to [{topic}]', flush=True)
        with interruptible(subscription.get) as get:
            _report_forever(meter, get, bus.clock)
    return 0


def _report_forever(meter: Meter, get: Callable[[float], Received | None], clock: Clock) -> None:
    next_ns = clock.now_ns() + round(REPORT_EVERY_S * NS_PER_S)
    while True:
        received = get(max(0.0, (next_ns - clock.now_ns()) / NS_PER_S))
        if received is not None:
            meter.add(received)
        if (now_ns := clock.now_ns()) >= next_ns:
            next_ns = now_ns + round(REPORT_EVERY_S * NS_PER_S)
            text = meter.report(now_ns)
            if text:
                print(text, flush=True)


class Durations:
    """The newest durations (s), of a kind that a child class collects."""

    def __init__(self, window: int) -> None:
        self._seconds: deque[float] = deque(maxlen=window)
        self._new = False

    def report(self, _: int) -> str | None:
        if not self._seconds:
            return None
        if not self._new:
            return 'no new messages'
        self._new = False
        return self._text(list(self._seconds))

    def _add(self, seconds: float) -> None:
        self._seconds.append(seconds)
        self._new = True

    def _text(self, seconds: list[float]) -> str:
        raise NotImplementedError


def _spread(seconds: list[float], digits: int) -> str:
    """The second line of what ros2 prints; the deviation is the population's (divided by n)."""
    least, most, deviation = f'{min(seconds):.{digits}f}', f'{max(seconds):.{digits}f}', statistics.pstdev(seconds)
    return f'\tmin: {least}s max: {most}s std dev: {deviation:.5f}s window: {len(seconds)}'


class Rate(Durations):
    """Messages per second, from arrival times."""

    _last_ns: int | None = None

    def add(self, received: Received) -> None:
        if self._last_ns is not None:
            self._add((received.received_ns - self._last_ns) / NS_PER_S)
        self._last_ns = received.received_ns

    def _text(self, seconds: list[float]) -> str:
        mean = statistics.fmean(seconds)
        return f'average rate: {1 / mean if mean > 0 else 0:.3f}\n{_spread(seconds, 3)}'


class Delay(Durations):
    """Seconds from the stamp in a message's header to its arrival."""

    def add(self, received: Received) -> None:
        from tactile_nodes.messages import stamp_ns

        header = getattr(received.message, 'header', None)
        if header is None:
            raise MessageError(f'{received.type_name} has no header, so there is no stamp to measure the delay from')
        self._add((received.received_ns - stamp_ns(header.stamp)) / NS_PER_S)

    def _text(self, seconds: list[float]) -> str:
        # ros2 rounds to milliseconds, which hides most delays on one host
        return f'average delay: {statistics.fmean(seconds):.6f}\n{_spread(seconds, 6)}'


class Bandwidth:
    """Bytes per second, from the first message of the window until now."""

    def __init__(self, window: int) -> None:
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=window)

    def add(self, received: Received) -> None:
        self._arrivals.append((received.received_ns, len(received.data)))

    def report(self, now_ns: int) -> str | None:
        if len(self._arrivals) < 2:
            return None
        sizes = [size for _, size in self._arrivals]
        rate = sum(sizes) / max((now_ns - self._arrivals[0][0]) / NS_PER_S, 1e-9)
        show = _in_unit(rate)
        mean = show(sum(sizes) / len(sizes))
        return (
            f'{show(rate)}/s from {len(sizes)} messages\n'
            f'\tMessage size mean: {mean} min: {show(min(sizes))} max: {show(max(sizes))}'
        )


def _in_unit(rate: float) -> Callable[[float], str]:
    """A formatter for bytes in the unit that suits `rate`, so that all numbers of a report have the same unit."""
    if rate < 1000:
        return lambda size: f'{size:.0f} B'
    if rate < 1_000_000:
        return lambda size: f'{size / 1000:.2f} KB'
    return lambda size: f'{size / 1_000_000:.2f} MB'
