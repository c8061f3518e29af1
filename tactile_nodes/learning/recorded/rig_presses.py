"""Presses of a running rig, put together from its messages as they come."""

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
"""A press is put together so long after it was told: its images travel beside it, and may come later."""
IDLE_NS = 2 * NS_PER_S
"""A rig that was asked to stop has done so when it has told of no press for so long."""
ABSENT_NS = 120 * NS_PER_S
"""A rig that has not come by then does not come: its process died of its settings, say. A slow machine takes 20 s."""
BETWEEN = 0


class RigPresses:
    """Takes messages in the node's thread, gives presses to the one that calibrates.

    `stop_rig` is called once, in the thread that first calls `stop`. What comes after the end is not kept: nobody would
    take it. Stamps are taken as they are: camera and rig have one clock here.
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
        self._told_ns: int | None = None
        self._idle_ns: int | None = None
        self._first_look_ns: int | None = None
        self._seen = self._stopping = self._over = self._taken = False

    # --- the node's side

    def image(self, message: types.Image) -> None:
        """An image of a press, or from before it."""
        with self._lock:
            if not self._over:
                self._aligner.take_image(message)

    def reference(self, message: types.Image) -> None:
        """A rest image."""
        with self._lock:
            if not self._over:
                self._aligner.take_reference(message)

    def state(self, message: types.RigState) -> None:
        """Where the tip is; between presses for long enough, a rig that was asked to stop has stopped."""
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
        """A press that is over, with the bytes that the recorder gets as well."""
        with self._lock:
            if self._over:
                return
            self._digest.update(data)
            self._attempts += 1
            self._give(self._aligner.take_press(message))
            self._told_ns = now_ns

    def look(self, now_ns: int, rig_is_there: bool) -> str:
        """To be called again and again: gives the last press once its images must have come, and ends with the rig.

        What has just become of the rig: that it has ended, or that it has not come at all; empty otherwise.
        """
        with self._lock:
            if self._told_ns is not None and now_ns - self._told_ns >= SETTLED_NS:
                self._give(self._aligner.finish())
                self._told_ns = None
            self._seen |= rig_is_there
            self._first_look_ns = now_ns if self._first_look_ns is None else self._first_look_ns
            if rig_is_there or self._over or not (self._seen or now_ns - self._first_look_ns >= ABSENT_NS):
                return ''
            self.end()
            if self._seen:
                return 'has ended'
            return f'did not appear within {ABSENT_NS // NS_PER_S} s; check why it did not start'

    def end(self) -> None:
        """The rig is no more, or has stopped: no press will come. Saying so twice is harmless."""
        with self._lock:
            if not self._over:
                self._over = True
                self._give(self._aligner.finish())
                self._ready.put(None)

    # --- the calibration's side

    def __iter__(self) -> Iterator[tuple[int, RecordedPress]]:
        while not self._taken:
            press = self._ready.get()
            self._taken = press is None
            if press is not None:
                yield 0, press

    @property
    def waiting(self) -> bool:
        """Whether the next one is there already: the rig does not wait for a fit."""
        return not self._ready.empty()

    def told(self, gel: str) -> list[dict[str, Any]]:
        """The entry of the bag that a recorder makes of these messages: its id follows from the presses alone."""
        with self._lock:
            problems = [f'{count} {what}' for what, count in self._aligner.odd.items()]
            bag_id = self._digest.copy().hexdigest()[:12]
            return [{'id': bag_id, 'gel': gel, 'attempts': self._attempts, 'problems': problems, 'clocks': []}]

    def stop(self) -> None:
        """Let the rig end its plan, tip up."""
        with self._lock:
            wanted = not self._stopping and not self._over
            self._stopping |= wanted
        if wanted:  # outside, since the rig's answer may take long while its messages come
            self._stop_rig()

    def close(self) -> None:
        """Nothing is open here."""

    def _give(self, press: RecordedPress | None) -> None:
        if press is not None:
            self._ready.put(press)
