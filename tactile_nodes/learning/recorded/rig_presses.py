"""Presses of a running rig, assembled from its messages as they arrive."""

from __future__ import annotations

import hashlib
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.learning.recorded.bags import Aligner, RecordedPress
from tactile_nodes.messages import stamp_ns, types

SETTLED_NS = NS_PER_S // 2
"""Delay between a press message and assembling the press: its images travel separately, and may arrive later."""
IDLE_NS = 2 * NS_PER_S
"""A rig that was asked to stop has stopped when it has reported no press for this long."""
ABSENT_NS = 120 * NS_PER_S
"""A rig that has not started by then is absent: wrong settings may have ended it. A slow machine takes 20 s."""
BETWEEN = 0


class RigPresses:
    """Takes messages in the node's thread, and gives presses to the calibration's thread.

    `stop_rig` is called once, in the thread that first calls `stop`. Messages after the end are dropped, since nothing
    would read them. Stamps are not corrected: camera and rig share one clock here.
    """

    bags: Sequence[Path] = ()
    rest_counts = True

    def __init__(self, stop_rig: Callable[[], None]) -> None:
        self._stop_rig = stop_rig
        self._lock = threading.RLock()
        self._aligner = Aligner()
        self._digest = hashlib.sha256()
        self._attempts = 0
        self._ready: queue.SimpleQueue[RecordedPress | None] = queue.SimpleQueue()
        self._last_press_ns: int | None = None
        self._idle_ns: int | None = None
        self._first_look_ns: int | None = None
        self._seen = self._stopping = self._over = self._taken = False

    # --- called by the node

    def image(self, message: types.Image) -> None:
        """Take an image of a press, or from before it."""
        with self._lock:
            if not self._over:
                self._aligner.take_image(message)
                self._give()

    def reference(self, message: types.Image) -> None:
        """Take a rest image."""
        with self._lock:
            if not self._over:
                self._aligner.take_reference(message)

    def state(self, message: types.RigState) -> None:
        """Take the tip's position. A rig asked to stop has stopped once it has been between presses long enough."""
        now_ns = stamp_ns(message.header.stamp)
        with self._lock:
            if self._over:
                return
            self._aligner.take_state(message)
            if not self._stopping or message.press != BETWEEN:
                self._idle_ns = None
            elif self._idle_ns is None:
                self._idle_ns = now_ns
            elif now_ns - self._idle_ns >= IDLE_NS:
                self.end()

    def press(self, message: types.Press, data: bytes, now_ns: int) -> None:
        """Take a finished press, with the bytes that the recorder also gets."""
        with self._lock:
            if self._over:
                return
            self._digest.update(data)
            self._attempts += 1
            self._aligner.take_press(message)
            self._give()
            self._last_press_ns = now_ns

    def look(self, now_ns: int, rig_is_there: bool) -> str:
        """Hand over the last press once its images must have arrived, and end with the rig. To be called repeatedly.

        Returns what happened to the rig: it has ended, or it never started; otherwise empty.
        """
        with self._lock:
            if self._last_press_ns is not None and now_ns - self._last_press_ns >= SETTLED_NS:
                self._give(over=True)
                self._last_press_ns = None
            self._seen |= rig_is_there
            self._first_look_ns = now_ns if self._first_look_ns is None else self._first_look_ns
            if rig_is_there or self._over or not (self._seen or now_ns - self._first_look_ns >= ABSENT_NS):
                return ''
            self.end()
            if self._seen:
                return 'has ended'
            return f'did not appear within {ABSENT_NS // NS_PER_S} s; check why it did not start'

    def end(self) -> None:
        """The rig has ended or stopped: no more presses will come. Calling this twice is harmless."""
        with self._lock:
            if not self._over:
                self._over = True
                self._give(over=True)
                self._ready.put(None)

    # --- called by the calibration

    def __iter__(self) -> Iterator[tuple[int, RecordedPress]]:
        while not self._taken:
            press = self._ready.get()
            self._taken = press is None
            if press is not None:
                yield 0, press

    @property
    def waiting(self) -> bool:
        """Whether the next press is already there: the rig does not wait for a fit."""
        return not self._ready.empty()

    def card_entries(self, gel: str) -> list[dict[str, Any]]:
        """The card's entry for the bag recorded from these messages. Its id depends on the presses alone."""
        with self._lock:
            problems = [f'{count} {fault}' for fault, count in self._aligner.odd.items()]
            bag_id = self._digest.copy().hexdigest()[:12]
            return [{'id': bag_id, 'gel': gel, 'attempts': self._attempts, 'problems': problems, 'clocks': []}]

    def stop(self) -> None:
        """Ask the rig to end its plan with the tip raised."""
        with self._lock:
            wanted = not self._stopping and not self._over
            self._stopping |= wanted
        if wanted:  # outside the lock: the rig's answer may take long, and its messages arrive meanwhile
            self._stop_rig()

    def close(self) -> None:
        """Nothing to close."""

    def _give(self, *, over: bool = False) -> None:
        for press in self._aligner.assembled(over=over):
            self._ready.put(press)
