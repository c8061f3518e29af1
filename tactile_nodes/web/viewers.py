"""The viewers, and what each receives next. Plain objects; times are passed in.

A viewer acknowledges each message that it has drawn, and has at most `IN_FLIGHT` messages on their way. So a slow
viewer sees fewer frames, but never older ones. A viewer that hangs, or whose window is hidden, receives nothing: only
the force samples are kept for it.
"""

from __future__ import annotations

from collections import deque

from tactile_nodes.web.packet import Packet

IN_FLIGHT = 2
HISTORY_PACKETS = 1800  # of samples: a minute at 30 a second, and more of the time when nobody watched
STUCK_AFTER_S = 3.0


class Viewer:
    """One page: the newest packet that it has not received, with the samples of all packets that it missed."""

    def __init__(self, history: deque[bytes], now_s: float) -> None:
        self.sent = self.passed_over = 0
        self._samples = deque(history, HISTORY_PACKETS)
        self._body: bytes | None = None
        self._in_flight = 0
        self._acknowledged_s = now_s

    def offer(self, packet: Packet) -> None:
        self.passed_over += self._body is not None
        self._body = packet.body
        self.remember(packet.samples)

    def remember(self, samples: bytes) -> None:
        self._samples.append(samples)

    def take(self) -> bytes | None:
        """The message to send now, if any."""
        if self._body is None or not self.has_room:
            return None
        message = b''.join((self._body, *self._samples))
        self._body = None
        self._samples.clear()
        self._in_flight += 1
        self.sent += 1
        return message

    def acknowledge(self, now_s: float) -> None:
        """It has drawn a message. A packet that waited while it was hidden may be hours old, and is not sent."""
        if not self.is_watching(now_s):
            self._body = None
        self._in_flight = max(0, self._in_flight - 1)
        self._acknowledged_s = now_s

    @property
    def has_room(self) -> bool:
        return self._in_flight < IN_FLIGHT

    def is_watching(self, now_s: float) -> bool:
        """Whether it still draws the packets that it gets."""
        return self.has_room or now_s - self._acknowledged_s < STUCK_AFTER_S


class Audience:
    """All viewers, and a minute or more of force samples for new ones. One thread changes it, any thread may read."""

    def __init__(self, most: int = 16) -> None:
        self.viewers: list[Viewer] = []
        self._most = most
        self._history: deque[bytes] = deque(maxlen=HISTORY_PACKETS)

    @property
    def is_full(self) -> bool:
        return len(self.viewers) >= self._most

    def join(self, now_s: float) -> Viewer:
        viewer = Viewer(self._history, now_s)
        self.viewers.append(viewer)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        self.viewers.remove(viewer)

    def offer(self, packet: Packet) -> None:
        if packet.samples:
            self._history.append(packet.samples)
        for viewer in self.viewers:
            viewer.offer(packet)

    def remember(self, samples: bytes) -> None:
        """Add force samples that come without a packet."""
        self._history.append(samples)
        for viewer in self.viewers:
            viewer.remember(samples)

    def watching(self, now_s: float) -> int:
        return sum(viewer.is_watching(now_s) for viewer in list(self.viewers))

    @property
    def has_room(self) -> bool:
        """Whether any viewer can receive a packet now; if not, none needs to be made."""
        return any(viewer.has_room for viewer in list(self.viewers))
