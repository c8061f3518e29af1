"""What the page shows: fed with messages as they came in and asked for packets; it reads no clock."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

from tactile_nodes.bus.protocol import Received
from tactile_nodes.errors import ImageError, MessageError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.measures import NS_PER_S
from tactile_nodes.viewing.state import Snapshot, ViewState
from tactile_nodes.web import packet, picture, telling
from tactile_nodes.web.packet import Packet
from tactile_nodes.web.recording import Recording

FRESH_S = 0.5  # a force older than this does not hold back the pictures that come without one
SLOW_EVERY_S = 0.5  # what a person cannot follow faster: rates, latencies, words
_KEPT = 12  # frames: images wait so long for the force that was made of them


class Scene:
    """Picture, motion and force of one instant belong together: they carry the same stamp."""

    def __init__(self, namespace: str = '/', start_ns: int = 0) -> None:
        self.view = ViewState(namespace, start_ns)
        self.recording = Recording(namespace)
        self.controls: dict[str, bool] = {}
        self._images: OrderedDict[int, Received] = OrderedDict()
        self._motions: OrderedDict[int, Any] = OrderedDict()
        self._truths: OrderedDict[int, float] = OrderedDict()
        self._calibration: Any = None
        self._samples: list[tuple[float, float, float]] = []
        self._jpegs: tuple[int, bytes] = (0, b'')
        self._new = True
        self._slow: tuple[int, dict[str, Any]] = (-NS_PER_S, {})

    # --- what comes in ------------------------------------------------------------------------------------------

    def add_image(self, received: Received) -> None:
        self._new = True
        _keep(self._images, stamp_ns(received.message.header.stamp), received)

    def add_motion(self, received: Received) -> None:
        _keep(self._motions, stamp_ns(received.message.header.stamp), received.message)

    def add_truth(self, received: Received) -> None:
        self.view.add_truth(received)
        _keep(self._truths, stamp_ns(received.message.header.stamp), received.message.total)

    def add_force(self, received: Received) -> None:
        self.view.add_force(received)
        self._new = True
        message = received.message
        captured_ns = stamp_ns(message.header.stamp)
        total = math.nan if message.status == message.STATUS_INVALID else message.total
        self._samples.append((captured_ns / NS_PER_S, total, self._truths.get(captured_ns, math.nan)))

    def add_diagnostics(self, received: Received) -> None:
        self.view.add_diagnostics(received)
        self.recording.add_diagnostics(received)

    def add_calibration(self, received: Received) -> None:
        """The drift monitor's word on whether the calibration still holds."""
        self._calibration = received.message

    def add_log(self, received: Received) -> None:
        self.view.add_log(received)

    # --- what is to be seen -------------------------------------------------------------------------------------

    def look_again(self) -> None:
        """Somebody watches again after a time in which no pictures were received."""
        self._images.clear()
        self._motions.clear()

    def touching_n(self, now_ns: int) -> float | None:
        """The total force [N] when something touches; None when nothing does, or nobody knows. From any thread."""
        force = self.view.force_within(now_ns, FRESH_S)
        return float(force.total) if force is not None and force.in_contact else None

    def is_due(self, now_ns: int) -> bool:
        """Whether there is anything to tell that was not told before, if only for how long nothing has come."""
        return self._new or now_ns - self._slow[0] >= SLOW_EVERY_S * NS_PER_S

    def samples(self) -> bytes:
        """The course of the force since the last time that somebody asked."""
        found = packet.samples(self._samples)
        self._samples.clear()
        return found

    def packet(self, now_ns: int, viewers: int) -> Packet:
        """All that there is to see now."""
        self._new = False
        shot = self.view.current(now_ns)
        at_ns = self._instant_ns(shot)
        told = {
            'age_s': round(shot.age_s, 3),
            'force': telling.force(shot.force),
            'truth': telling.truth(shot.truth),
            'image': {'stamp_s': at_ns / NS_PER_S} if at_ns else None,
            'motion': telling.motion(self._motions.get(at_ns)),
            'slow': self._slowly(now_ns) | {'viewers': viewers},
        }
        sections = {'bins': _bins(shot.force), 'motion': self._arrows(at_ns), 'image': self._jpeg(at_ns)}
        return Packet(packet.body(told, sections), self.samples())

    def _instant_ns(self, shot: Snapshot) -> int:
        """The stamp of the picture to show: that of the force, unless none has come for a while."""
        forced_ns = stamp_ns(shot.force.header.stamp) if shot.force is not None else 0
        if forced_ns in self._images and shot.age_s < FRESH_S:
            return forced_ns
        return next(reversed(self._images), 0)

    def _arrows(self, at_ns: int) -> bytes:
        message = self._motions.get(at_ns)
        try:
            found = picture.arrows(message) if message is not None else None
        except MessageError as error:
            self.view.add_note(str(error))
            return b''
        return found.astype('<f4').tobytes() if found is not None else b''

    def _jpeg(self, at_ns: int) -> bytes:
        """Encoded once, however often it is shown."""
        if self._jpegs[0] != at_ns:
            received = self._images.get(at_ns)
            self._jpegs = at_ns, self._encoded(received) if received is not None else b''
        return self._jpegs[1]

    def _encoded(self, received: Received) -> bytes:
        try:
            return picture.jpeg(received.message)
        except ImageError as error:
            self.view.add_note(str(error))
            return b''

    def _slowly(self, now_ns: int) -> dict[str, Any]:
        made_ns, told = self._slow
        if now_ns - made_ns >= SLOW_EVERY_S * NS_PER_S:
            told = {
                **telling.slowly(self.view.snapshot(now_ns)),
                'calibration': telling.calibration(self._calibration),
                'recording': self.recording.told(),
                'controls': self.controls,
            }
            self._slow = now_ns, told
        return told


def _keep(place: OrderedDict[int, Any], at_ns: int, thing: Any) -> None:
    place[at_ns] = thing
    if len(place) > _KEPT:
        place.popitem(last=False)


def _bins(force: Any) -> bytes:
    return force.normal_force.astype('<f4').tobytes() if force is not None else b''
