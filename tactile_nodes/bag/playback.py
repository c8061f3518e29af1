"""Plays a bag: passes on each message when it is due."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection

from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.messages import type_name, types


class Timeline:
    """Maps the clock's time to the bag's time. While it is paused the bag's time stands still.

    >>> line = Timeline(rate=2.0)
    >>> line.start(now_ns=1000, bag_ns=50)
    >>> line.bag_ns(1010), line.due_ns(90)
    (70, 1020)
    """

    def __init__(self, rate: float = 1.0) -> None:
        self._lock = threading.Lock()
        self.rate = rate
        self._now_ns = self._bag_ns = 0
        self.paused = False

    def start(self, now_ns: int, bag_ns: int) -> None:
        """At `now_ns` the position is `bag_ns`; also used to step while paused."""
        with self._lock:
            self._now_ns, self._bag_ns = now_ns, bag_ns

    def pause(self, now_ns: int) -> None:
        self._change(now_ns, self.rate, True)

    def resume(self, now_ns: int) -> None:
        self._change(now_ns, self.rate, False)

    def set_rate(self, now_ns: int, rate: float) -> None:
        """Continue at another speed, without a jump."""
        self._change(now_ns, rate, self.paused)

    def bag_ns(self, now_ns: int) -> int:
        with self._lock:
            return self._at(now_ns)

    def due_ns(self, bag_ns: int) -> int | None:
        """The clock's time at which the bag's time will be `bag_ns`; None while paused."""
        with self._lock:
            return None if self.paused else self._now_ns + round((bag_ns - self._bag_ns) / self.rate)

    def _at(self, now_ns: int) -> int:
        return self._bag_ns if self.paused else self._bag_ns + round((now_ns - self._now_ns) * self.rate)

    def _change(self, now_ns: int, rate: float, paused: bool) -> None:
        with self._lock:
            self._now_ns, self._bag_ns = now_ns, self._at(now_ns)
            self.rate, self.paused = rate, paused


_SLICE_NS = 20_000_000  # longest reaction time to a pause, a stop or another rate
_STOOD_STILL_NS = NS_PER_S  # after Ctrl-Z, or if the computer slept, what was missed is not sent all at once
_ADD_UP = type_name(types.TFMessage)
_HEARD_WITHIN_NS = 5 * NS_PER_S  # a recorder may receive an earlier latched message this late


class Playback:
    """Runs in the thread that calls `run`; all other methods may be called from any thread.

    Args:
        reader: the bag.
        topics: the topics to play.
        publish: called with each message when it is due.
        clock: the clock for the messages' times.
        rate: speed, 1.0 as recorded.
        tick: called with the bag's time `tick_hz` times per second, also while paused; not called at 0.0.
    """

    def __init__(
        self,
        reader: BagReader,
        topics: Collection[str],
        publish: Callable[[BagMessage], None],
        clock: Clock,
        *,
        rate: float = 1.0,
        tick: Callable[[int], None] | None = None,
        tick_hz: float = 0.0,
    ) -> None:
        self.timeline = Timeline(rate)
        self.timeline.start(clock.now_ns(), reader.extent.start_ns)
        self.published = 0
        self.latest_ns = 0
        self._reader = reader
        self._topics = topics
        self._hand_on = publish
        self._clock = clock
        self._tick_with = tick
        self._tick_hz = tick_hz
        self._next_tick_ns = 0
        self._steps = threading.Semaphore(0)
        self._running = True
        self._announced: set[tuple[str, int, int]] | None = None

    def pause(self) -> None:
        self.timeline.pause(self._clock.now_ns())

    def resume(self) -> None:
        self.timeline.resume(self._clock.now_ns())

    def set_rate(self, rate: float) -> None:
        self.timeline.set_rate(self._clock.now_ns(), rate)

    def step(self) -> None:
        self._steps.release()

    def stop(self) -> None:
        self._running = False

    @property
    def stopped(self) -> bool:
        return not self._running

    def wait(self, seconds: float) -> None:
        end_ns = self._clock.now_ns() + round(seconds * NS_PER_S)
        while self._running and (now_ns := self._clock.now_ns()) < end_ns:
            self._clock.sleep_until(min(end_ns, now_ns + _SLICE_NS))

    def announce(self, start_offset_s: float = 0.0) -> None:
        """Publish the latched messages up to the start, so that subscribers have them before the first picture.

        A recorder may have received one after the first pictures, although its stamp is older.
        """
        start_ns = self._start_ns(start_offset_s)
        latched = [name for name in self._topics if self._reader.topics[name].latched]
        before = {_replaced_by(message): message for message in self._reader.messages(latched, end_ns=start_ns)}
        oldest_ns = self._oldest_stamp_ns(start_ns, set(self._topics) - set(latched))
        heard_late = self._reader.messages(latched, start_ns, start_ns + _HEARD_WITHIN_NS)
        latched_early = [message for message in heard_late if message.publish_ns < oldest_ns]
        for message in (*before.values(), *latched_early):
            self._publish(message)
        self._announced = {_key(message) for message in latched_early}

    def run(self, start_offset_s: float = 0.0, loop: bool = False) -> None:
        """Play from `start_offset_s` to the end; with `loop`, repeatedly, unless only latched messages are left."""
        while self._run_once(start_offset_s) and loop:
            self._announced = None

    def _run_once(self, start_offset_s: float) -> bool:
        """Returns whether anything was played after the announcement, and to the end."""
        start_ns = self._start_ns(start_offset_s)
        if self._announced is None:
            self.announce(start_offset_s)
        self.timeline.start(self._clock.now_ns(), start_ns)
        announced = self.published
        for message in self._reader.messages(self._topics, start_ns):
            if self._announced and _key(message) in self._announced:
                continue
            if not self._wait_until_due(message.log_ns):
                return False
            self._publish(message)
        return self._running and self.published > announced

    def _start_ns(self, offset_s: float) -> int:
        return self._reader.extent.start_ns + round(offset_s * NS_PER_S)

    def _oldest_stamp_ns(self, start_ns: int, topics: Collection[str]) -> int:
        """The oldest stamp of the messages that are played first; stamps and receive times may use different clocks."""
        first = self._reader.messages(topics, start_ns, start_ns + NS_PER_S)
        return min((message.publish_ns for message in first), default=start_ns)

    def _publish(self, message: BagMessage) -> None:
        self._hand_on(message)
        self.published += 1

    def _wait_until_due(self, log_ns: int) -> bool:
        while self._running:
            now_ns = self._clock.now_ns()
            wake_ns = self._tick(now_ns)
            due_ns = self.timeline.due_ns(log_ns)
            if due_ns is None and self._steps.acquire(blocking=False):
                self.timeline.start(now_ns, log_ns)
                return True
            if due_ns is not None and due_ns <= now_ns:
                self.latest_ns = max(self.latest_ns, now_ns - due_ns)
                if now_ns - due_ns > _STOOD_STILL_NS:
                    self.timeline.start(now_ns, log_ns)
                return True
            self._clock.sleep_until(wake_ns if due_ns is None else min(due_ns, wake_ns))
        return False

    def _tick(self, now_ns: int) -> int:
        """Publish the bag's time when due. Returns when to call again at the latest."""
        if self._tick_with is None or self._tick_hz <= 0.0:
            return now_ns + _SLICE_NS
        if now_ns >= self._next_tick_ns:
            self._tick_with(self.timeline.bag_ns(now_ns))
            period_ns = round(NS_PER_S / self._tick_hz)
            in_step_ns = self._next_tick_ns + period_ns
            self._next_tick_ns = in_step_ns if in_step_ns > now_ns else now_ns + period_ns
        return min(self._next_tick_ns, now_ns + _SLICE_NS)


def _replaced_by(message: BagMessage) -> tuple[str, bytes]:
    """Equal for a later message that takes the place of this one; transforms of several publishers add up."""
    return message.topic, message.data if message.type_name == _ADD_UP else b''


def _key(message: BagMessage) -> tuple[str, int, int]:
    return message.topic, message.log_ns, message.publish_ns
