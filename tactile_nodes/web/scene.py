"""The content of the page: fed with received messages and asked for packets; it reads no clock."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_nodes.bus.protocol import Received
from tactile_nodes.errors import ImageError, MessageError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.measures import NS_PER_S
from tactile_nodes.viewing.state import Snapshot, ViewState
from tactile_nodes.viewing.surface import Surface, over_half, surface_of
from tactile_nodes.web import packet, page_data, picture
from tactile_nodes.web.packet import Packet
from tactile_nodes.web.recording import Recording

FRESH_S = 0.5  # pictures without a force are not held back for a force older than this
FIELD_WITHIN_S = 0.1  # a force field comes shortly after its force: until then the previous force is shown
SLOW_EVERY_S = 0.5  # values that a person cannot read faster: rates, latencies, text
_KEPT = 12  # frames: an image waits this long for the force computed from it


class Scene:
    """Keeps picture, motion and force of one instant together: they carry the same stamp."""

    def __init__(self, namespace: str = '/', start_ns: int = 0) -> None:
        self.view = ViewState(namespace, start_ns)
        self.recording = Recording(namespace)
        self.controls: dict[str, bool] = {}
        self.hand: Any = None
        """The last HandWrench, if the sensor is one of a hand."""
        self.host = ''
        """The machine that the force comes from, if it is another one."""
        self._images: OrderedDict[int, Received] = OrderedDict()
        self._motions: OrderedDict[int, Any] = OrderedDict()
        self._truths: OrderedDict[int, Any] = OrderedDict()
        self._forces: OrderedDict[int, Any] = OrderedDict()
        self._surfaces: OrderedDict[int, Surface] = OrderedDict()
        self._calibration: Any = None
        self._samples: list[tuple[float, float, float]] = []
        self._jpegs: tuple[int, bytes] = (0, b'')
        self._new = True
        self._slow: tuple[int, dict[str, Any]] = (-NS_PER_S, {})

    # --- input ------------------------------------------------------------------------------------------

    def add_image(self, received: Received) -> None:
        self._new = True
        _keep(self._images, stamp_ns(received.message.header.stamp), received)

    def add_motion(self, received: Received) -> None:
        _keep(self._motions, stamp_ns(received.message.header.stamp), received.message)

    def add_truth(self, received: Received) -> None:
        self.view.add_truth(received)
        _keep(self._truths, stamp_ns(received.message.header.stamp), received.message)

    def add_force(self, received: Received) -> None:
        self.view.add_force(received)
        self._new = True
        message = received.message
        captured_ns = stamp_ns(message.header.stamp)
        _keep(self._forces, captured_ns, message)
        total = math.nan if message.status == message.STATUS_INVALID else message.total
        truth = self._truths.get(captured_ns)
        self._samples.append((captured_ns / NS_PER_S, total, math.nan if truth is None else truth.total))

    def add_field(self, received: Received) -> None:
        """Add a received force field.

        Raises:
            MessageError: its arrays do not fill its grid.
        """
        if (surface := surface_of(received.message)) is not None:
            self._new = True
            _keep(self._surfaces, stamp_ns(received.message.header.stamp), surface)

    def add_diagnostics(self, received: Received) -> None:
        self.view.add_diagnostics(received)
        self.recording.add_diagnostics(received)

    def add_calibration(self, received: Received) -> None:
        """The drift monitor's statement on the validity of the calibration."""
        self._calibration = received.message

    def add_log(self, received: Received) -> None:
        self.view.add_log(received)

    # --- output -------------------------------------------------------------------------------------

    def look_again(self) -> None:
        """Start again after a time without viewers, in which no pictures were received."""
        self._images.clear()
        self._motions.clear()
        self._surfaces.clear()

    def touching_n(self, now_ns: int) -> float | None:
        """The total force [N] if there is contact; None if there is none, or if it is unknown. From any thread."""
        force = self.view.force_within(now_ns, FRESH_S)
        return float(force.total) if force is not None and force.in_contact else None

    def is_due(self, now_ns: int) -> bool:
        """Whether there is anything new to send, even if only the time since the last message."""
        return self._new or now_ns - self._slow[0] >= SLOW_EVERY_S * NS_PER_S

    def samples(self) -> bytes:
        """The samples of the force since the previous call."""
        found = packet.samples(self._samples)
        self._samples.clear()
        return found

    def packet(self, now_ns: int) -> Packet:
        self._new = False
        shot = self._shown(now_ns)
        at_ns = self._instant_ns(shot)
        surface = self._surfaces.get(_stamp_ns(shot.force))
        fields = {
            'age_s': round(shot.age_s, 3),
            'force': page_data.force(shot.force),
            'surface': page_data.surface(surface),
            'truth': page_data.truth(shot.truth),
            'image': {'stamp_s': at_ns / NS_PER_S} if at_ns else None,
            'motion': page_data.motion(self._motions.get(at_ns)),
            'slow': self._slowly(now_ns),
            'hand': page_data.hand(self.hand),
        }
        sections = {
            'bins': _bins(shot.force),
            'surface': _cells(surface, shot.force),
            'motion': self._arrows(at_ns),
            'image': self._jpeg(at_ns),
        }
        return Packet(packet.body(fields, sections), self.samples())

    def _shown(self, now_ns: int) -> Snapshot:
        """The snapshot to show; while the field of a force is on its way, the previous one, so that both match."""
        shot = self.view.current(now_ns)
        last_ns = next(reversed(self._surfaces), 0)
        behind_ns = _stamp_ns(shot.force) - last_ns
        is_waiting = 0 < behind_ns < FIELD_WITHIN_S * NS_PER_S and last_ns in self._forces
        if not is_waiting or shot.force.status == shot.force.STATUS_INVALID:
            return shot
        truth = None if shot.truth is None else self._truths.get(last_ns)
        return replace(shot, force=self._forces[last_ns], truth=truth)

    def _instant_ns(self, shot: Snapshot) -> int:
        """The stamp of the picture to show: that of the force, unless there has been none for a while."""
        forced_ns = _stamp_ns(shot.force)
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
        made_ns, fields = self._slow
        if now_ns - made_ns >= SLOW_EVERY_S * NS_PER_S:
            fields = {
                **page_data.slowly(self.view.snapshot(now_ns)),
                'calibration': page_data.calibration(self._calibration),
                'recording': self.recording.summary(now_ns),
                'controls': self.controls,
                'host': self.host,
            }
            self._slow = now_ns, fields
        return fields


def _keep(place: OrderedDict[int, Any], at_ns: int, thing: Any) -> None:
    place[at_ns] = thing
    if len(place) > _KEPT:
        place.popitem(last=False)


def _stamp_ns(force: Any) -> int:
    return stamp_ns(force.header.stamp) if force is not None else 0


def _bins(force: Any) -> bytes:
    return force.normal_force.astype('<f4').tobytes() if force is not None else b''


def _cells(surface: Surface | None, force: Any) -> bytes:
    """For each cell: pressure, shear along x and y [kPa], and pressure over half of the maximum of its contact."""
    if surface is None:
        return b''
    outlines = over_half(surface, force.contacts)
    return np.dstack([surface.pressure_kpa, surface.shear_kpa, outlines]).astype('<f4').tobytes()
