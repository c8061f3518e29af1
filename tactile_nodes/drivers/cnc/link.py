"""Lines of text to and from a controller, read continuously and stamped on arrival.

With a thread, `wait` waits for what the thread receives. Without one (`threaded` false), the waiting thread also reads,
which makes a dialogue with an emulator in the same thread exactly repeatable.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.cnc.contract import Traffic
from tactile_nodes.drivers.serial_port import Port, SerialPort
from tactile_nodes.errors import DeviceError, DeviceLostError

READ_S = 0.05
SILENT = 'is silent; check its cable and power'
SILENT_IN_MOTION = 'is silent while it moves; check its cable and power'
LONGEST_LOOK_NS = 60_000_000
LONGEST_LINE = 4096


@dataclass
class Request:
    """A sent line and its result."""

    text: str
    sent_ns: int = 0
    answered_ns: int = 0
    error: DeviceError | None = None
    lines: list[str] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether it was answered, or has failed."""
        return bool(self.answered_ns) or self.error is not None


class Silence:
    """How long a response is overdue, as measured by its listener.

    A busy computer delays the listener, and devices that it emulates. So each look counts for no longer than a look
    should take. Unread data is not missing: `look` is called only after reading.
    """

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._looked_ns = self._felt_ns = 0

    def look(self, since_ns: int | None, now_ns: int) -> None:
        """Count the time since the last look; `since_ns`: since when a response is due (None: none is due)."""
        if since_ns != self._since_ns:
            self._since_ns, self._felt_ns, self._looked_ns = since_ns, 0, since_ns or now_ns
        self._felt_ns += min(now_ns - self._looked_ns, LONGEST_LOOK_NS)
        self._looked_ns = now_ns

    def is_over(self, limit_s: float) -> bool:
        """Whether it is overdue for longer than the limit."""
        return self._since_ns is not None and self._felt_ns > limit_s * NS_PER_S


class Link:
    """A port with a listener.

    Args:
        port: open.
        clock: stamps and deadlines.
        heard: called with every line and its stamp, under `changed`.
        idle: called many times per second, under `changed`, for example to request reports.
        traffic: gets every byte.
        threaded: read in a separate thread.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        on_line: Callable[[str, int], None],
        idle: Callable[[], None],
        traffic: Traffic | None = None,
        threaded: bool = True,
    ) -> None:
        self._port = port
        self._clock = clock
        self._on_line = on_line
        self._idle = idle
        self._traffic = traffic
        self._partial = bytearray()
        self._closing = False
        self.lost: DeviceLostError | None = None
        self.changed = threading.Condition(threading.RLock())
        self._thread = threading.Thread(target=self._listen, name=f'cnc {port.name}', daemon=True) if threaded else None

    @property
    def descriptor(self) -> int | None:
        """File descriptor of the port, if it is a port of the operating system."""
        return self._port.descriptor if isinstance(self._port, SerialPort) else None

    def start(self) -> None:
        if self._thread is not None:
            self._thread.start()

    def send(self, data: bytes) -> int:
        """Write bytes to the line, before anything that waits; returns the stamp.

        Raises:
            DeviceLostError: the port is gone.
        """
        with self.changed:
            self._check()
            stamp_ns = self._clock.now_ns()
            try:
                self._port.write(data)
            except DeviceLostError as error:
                self.lost = error
                raise
            if self._traffic is not None:
                self._traffic('>', stamp_ns, data)
            return stamp_ns

    def wait(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Listen until a condition holds; False: it did not hold in time, as `Silence` counts time.

        Raises:
            DeviceLostError: the port is gone.
        """
        left_ns = round(timeout_s * NS_PER_S)
        with self.changed:
            while not done():
                self._check()
                if left_ns <= 0:
                    return False
                looked_ns, look_s = self._clock.now_ns(), min(left_ns / NS_PER_S, READ_S)
                if self._thread is not None:
                    self.changed.wait(look_s)
                else:
                    self._pump(look_s)
                left_ns -= min(self._clock.now_ns() - looked_ns, LONGEST_LOOK_NS)
            return True

    def close(self) -> None:
        """Stop listening and close the port."""
        self._closing = True
        if self._thread is not None and self._thread.is_alive():
            self._thread.join()
        self._port.close()

    def _listen(self) -> None:
        while not self._closing and self.lost is None:
            self._pump(READ_S)

    def _pump(self, timeout_s: float) -> None:
        try:
            data = self._port.read(timeout_s)
            with self.changed:
                if data:
                    self._take(data)
                    self.changed.notify_all()
                if not self._closing:
                    self._idle()
        except DeviceLostError as error:
            with self.changed:
                self.lost = error
                self.changed.notify_all()

    def _take(self, data: bytes) -> None:
        stamp_ns = self._clock.now_ns()
        if self._traffic is not None:
            self._traffic('<', stamp_ns, data)
        self._partial += data
        *lines, rest = self._partial.split(b'\n')
        self._partial = bytearray(rest[-LONGEST_LINE:])
        for line in lines:
            if text := line.decode('ascii', 'replace').strip():
                self._on_line(text, stamp_ns)

    def _check(self) -> None:
        if self.lost is not None:
            raise DeviceLostError(str(self.lost)) from self.lost
        if self._closing:
            raise DeviceLostError(f'{self._port.name} is closed; connect again')
