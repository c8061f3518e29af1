"""Capture times from kernel stamps and arrival times, and the number of missing frames."""

from __future__ import annotations

import statistics
from collections import deque

from tactile_nodes import clock

OLDEST_NS = 2_000_000_000  # a device that is read continuously returns no older frames
MOST_BUFFERED = 32  # frames that a driver holds while its reader pauses (VIDEO_MAX_FRAME)
NS_PER_MS = 1_000_000
CADENCE_FRAMES = 31
SLOWER = 1.2


class KernelStamps:
    """Stamps of a V4L2 device: the kernel's if they are plausible, else arrival times, permanently.

    ``CAP_PROP_POS_MSEC`` after a grab is the V4L2 buffer's time stamp in ms of CLOCK_MONOTONIC. uvcvideo takes it when
    the first USB packet of the frame arrives: after the exposure, a constant time before the picture is complete.
    Drivers that use another clock, or no stamps, are detected by an implausible age. After a pause of this computer
    the frames that the driver held meanwhile are as old as their stamps.
    """

    def __init__(self) -> None:
        self.complaint = ''
        self._last_ns = 0
        self._old = 0

    @property
    def source(self) -> str:
        """The stamps in use, as text."""
        return f'arrival ({self.complaint})' if self.complaint else 'kernel, CLOCK_MONOTONIC'

    def stamp(self, position_ms: float, monotonic_ns: int) -> int:
        """The stamp, on the host's time base, of a frame that was returned at `monotonic_ns`."""
        taken_ns = round(position_ms * NS_PER_MS)
        if not self.complaint:
            self._old = self._old + 1 if monotonic_ns - taken_ns > OLDEST_NS else 0
            held = self._last_ns > 0 and self._old <= MOST_BUFFERED
            self.complaint = _complaint(taken_ns, monotonic_ns, self._last_ns, held)
        self._last_ns = max(self._last_ns + 1, monotonic_ns if self.complaint else taken_ns)
        return clock.from_monotonic_ns(self._last_ns)


def _complaint(taken_ns: int, now_ns: int, last_ns: int, held: bool) -> str:
    if taken_ns <= 0:
        return 'the driver gives no stamps'
    if taken_ns > now_ns:
        return f"the driver's stamps are {(taken_ns - now_ns) / 1e9:.3f} s in the future"
    if now_ns - taken_ns > OLDEST_NS and not held:
        return f"the driver's stamps are {(now_ns - taken_ns) / 1e9:.3f} s old"
    if taken_ns <= last_ns:
        return "the driver's stamps do not increase"
    return ''


class Cadence:
    """Counts missing frames of a camera that may be slower than announced.

    Cameras lower their rate for longer exposures, but still announce the old one. If most recent gaps are longer than
    the announced period, the longer gap is taken as the period. This is reported, and not counted as a loss at every
    frame.

    Args:
        fps: announced rate; 0: not announced, so no frame counts as missing.
    """

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._last_ns = 0
        self._gaps_ns: deque[int] = deque(maxlen=CADENCE_FRAMES)

    @property
    def fps(self) -> float:
        """Frames per second: as announced, or as observed if that is clearly less."""
        if self._fps <= 0 or len(self._gaps_ns) < CADENCE_FRAMES:
            return self._fps
        observed_fps = clock.NS_PER_S / statistics.median(self._gaps_ns)
        return observed_fps if observed_fps * SLOWER < self._fps else self._fps

    @property
    def complaint(self) -> str:
        """A message if it is slower than announced; else empty."""
        fps = self.fps
        return f'it sends {fps:.1f} frames/s, but announces {self._fps:g}' if fps != self._fps else ''

    def missing(self, stamp_ns: int) -> int:
        """Number of missing frames between the last frame and this one.

        At 60 fps a gap of 50 ms is three periods, so two are missing; a gap of 24 ms is jitter.
        """
        fps, last_ns, self._last_ns = self.fps, self._last_ns, stamp_ns
        if last_ns == 0:
            return 0
        gap_ns = stamp_ns - last_ns
        self._gaps_ns.append(max(1, gap_ns))
        return max(0, round(gap_ns * fps / clock.NS_PER_S) - 1)
