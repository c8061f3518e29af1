"""An ATI Net F/T box: every record over UDP, in N and N·m, stamped with the box's own sample counter.

The box stops by itself if this host fails: it is asked for a finite number of records, and asked again before they are
used up. No setting of the box is changed: no bias (a collection tares on the host instead) and no filter; the output
rate only if the settings request it.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
from collections.abc import Mapping

from tactile_nodes import clock as clocks
from tactile_nodes.clock import Clock
from tactile_nodes.drivers.force_torque import net_ft_config as configs
from tactile_nodes.drivers.force_torque import net_ft_rdt as rdt
from tactile_nodes.drivers.force_torque.clock import TickClock
from tactile_nodes.drivers.force_torque.contract import AXES, Flag, ForceTorqueSettings
from tactile_nodes.drivers.force_torque.net_ft_config import BoxConfig
from tactile_nodes.drivers.force_torque.queue import SampleQueue
from tactile_nodes.drivers.force_torque.stream import Connection, StreamedForceTorque
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)

RECEIVE_BUFFER = 4 << 20  # five seconds of records at 7000 Hz, including overhead of the kernel
WAIT_S = 0.05
TRY_S = 0.1
PERIODS_OF_A_TRY = 3  # a box restarts its stream with every request, so it needs time for a record
LARGEST_DATAGRAM = 65_535


class NetFtConnection(Connection):
    """A box that streams to this host.

    Raises:
        DeviceError: as `net_ft_config.read_config`; or RDT is disabled in the box.
        DeviceTimeoutError: it does not start.
    """

    def __init__(self, host: str, settings: ForceTorqueSettings, clock: Clock) -> None:
        self._host = host
        self._settings = settings
        self._clock = clock
        self.config = _configured(host, settings)
        self.tracker = rdt.StreamTracker()
        self._ticks = TickClock(self.config.internal_rate_hz, delay_ns=round(settings.delay_ms * 1e6))
        self._stalls = 0
        self._renew_at_s = 0.0
        self._first: tuple[bytes, int] | None = None
        self._address = _address(host)
        self._socket = _socket(host)
        try:
            self._start()
        except BaseException:
            self._socket.close()
            raise

    @property
    def rate_hz(self) -> float:
        """Rate from the box's counters; before that, as the box reports it."""
        if self.tracker.step and not (self.config.rate_hz and self._ticks.complaint):
            return self.config.internal_rate_hz / self.tracker.step
        return self.config.rate_hz

    @property
    def announced_hz(self) -> float:
        return self.config.rate_hz

    @property
    def description(self) -> Mapping[str, str]:
        fields, counters = self.config.fields, self.tracker.counters
        return {
            'kind': 'ATI Net F/T',
            'address': self._host,
            'calibration': fields.get('cfgcalsn', ''),
            'counts per unit': f'{fields.get("cfgcpf")} per {fields.get("scfgfu")}, '
            f'{fields.get("cfgcpt")} per {fields.get("scfgtu")}',
            'ranges': fields.get('cfgmr', ''),
            'filter': fields.get('setuserfilter', ''),
            'bias in the box': fields.get('setbias', ''),
            'rate': f'{self.rate_hz:.0f}',
            'clock drift': self._ticks.drift_text,
            'records lost, doubled, late, malformed': f'{counters.lost}, {counters.duplicates}, '
            f'{counters.out_of_order}, {counters.malformed}',
            'times stalled': str(self._stalls),
        }

    @property
    def complaint(self) -> str:
        """A message if the rate differs from the requested one, or the counter does not keep its rate."""
        requested = self._settings.rate_hz
        if requested > 0 and self.rate_hz and not _near(requested, self.rate_hz, self.config.internal_rate_hz):
            return (
                f'{requested:g} samples/s were requested, but the box sends {self.rate_hz:.0f}; '
                'see its Communications page'
            )
        return self._ticks.complaint

    def fetch(self, queue: SampleQueue) -> None:
        """Receive a datagram, and renew the request when it is due."""
        if clocks.monotonic_s() >= self._renew_at_s:
            self._request()
        datagram, self._first = (self._first or self._receive()), None
        if datagram is None:
            return
        data, arrival_ns = datagram
        record = rdt.record_in(data)
        if record is None:
            self.tracker.counters.malformed += 1
            return
        expecting = not self.tracker.renewed
        self._put(record, arrival_ns, queue)
        if expecting and self.tracker.renewed:
            self._renew_at_s = clocks.monotonic_s() + self._settings.net_ft.renew_s

    def close(self) -> None:
        """Stop the box now; it would also stop by itself later."""
        with contextlib.suppress(OSError):
            self._send(rdt.request(rdt.STOP))
        self._socket.close()

    def _put(self, record: rdt.Record, arrival_ns: int, queue: SampleQueue) -> None:
        accepted = self.tracker.accept(record)
        if accepted is None:
            return
        if accepted.rebooted:  # its units may be others now
            raise DeviceLostError(f'the box at {self._host} has restarted; check its power supply')
        flags = rdt.flags_of(record.status)
        if accepted.stalled:
            self._stalls += 1
            flags |= Flag.STALLED
        ticks = self._ticks.unwrapped(record.ft_sequence)
        stamp_ns = self._ticks.stamp(ticks, arrival_ns)
        flags |= self._ticks.flags
        if not self._ticks.settled and not accepted.stalled:
            return
        a, b, c, d, e, f = (
            count * unit for count, unit in zip(record.counts, self.config.units_per_count, strict=True)
        )
        queue.put(
            (a, b, c, d, e, f), record.counts, stamp_ns, arrival_ns, ticks, flags, record.status, accepted.missing
        )

    def _start(self) -> None:
        """Send requests until a record comes: the box does not acknowledge requests, and a request can get lost."""
        for _ in range(self._settings.net_ft.start_tries):
            self._request()
            self._socket.settimeout(self._try_s)
            if (datagram := self._receive()) is not None:
                self._first = datagram
                self._socket.settimeout(WAIT_S)
                return
        raise DeviceTimeoutError(
            f'the box at {self._host} sends no records when asked on port {self._settings.net_ft.rdt_port}; check that '
            'no firewall blocks UDP and that no other program uses the box'
        )

    @property
    def _try_s(self) -> float:
        """Time until the next request, if the new stream has not started."""
        return max(TRY_S, PERIODS_OF_A_TRY / self.rate_hz if self.rate_hz else 0.0)

    def _request(self) -> None:
        """Request records; `fetch` repeats this until the new stream starts."""
        self.tracker.requested()
        most_hz = max(self.rate_hz, self.config.rate_hz) or self.config.internal_rate_hz
        count = math.ceil(self._settings.net_ft.count_s * most_hz)
        try:
            self._send(rdt.request(rdt.START_REALTIME, count))
        except OSError as error:
            raise DeviceLostError(
                f'cannot reach the box at {self._host} ({error.strerror or error}); check the network of this computer'
            ) from error
        self._renew_at_s = clocks.monotonic_s() + self._try_s

    def _send(self, request: bytes) -> None:
        self._socket.sendto(request, (self._address, self._settings.net_ft.rdt_port))

    def _receive(self) -> tuple[bytes, int] | None:
        """A datagram of the box, from any port; data of other senders is dropped."""
        try:
            data, sender = self._socket.recvfrom(LARGEST_DATAGRAM)
        except (TimeoutError, ConnectionRefusedError):
            return None
        except OSError as error:
            raise DeviceLostError(
                f'cannot receive from the box at {self._host} ({error.strerror or error}); check the network of this '
                'computer'
            ) from error
        return (data, self._clock.now_ns()) if sender[0] == self._address else None


def _near(requested: float, given: float, internal: float) -> bool:
    """Whether a rate is the nearest that the box supports: the internal rate divided by an integer."""
    return requested <= given * 1.001 and given <= internal / max(1, internal // requested) * 1.001


def _configured(host: str, settings: ForceTorqueSettings) -> BoxConfig:
    port = settings.net_ft.http_port
    config = configs.read_config(host, port)
    wanted = settings.rate_hz if settings.net_ft.set_rate else 0.0
    if wanted > 0 and not _near(wanted, config.rate_hz, config.internal_rate_hz):
        configs.set_rate(host, port, settings.rate_hz, config.axia)
        config = configs.read_config(host, port)
    if not config.enabled:
        raise DeviceError(f'RDT is disabled in the box at {host}; enable it on its Communications page')
    return config


def _address(host: str) -> str:
    """The numerical address, as in the sender of datagrams."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise DeviceNotFoundError(f'cannot find the box at {host} ({error.strerror or error})') from error


def _socket(host: str) -> socket.socket:
    """An unconnected socket: a connected one would drop data that a box sends from another port."""
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        opened.bind(('', 0))
    except OSError as error:
        opened.close()
        raise DeviceNotFoundError(f'cannot open a socket for the box at {host} ({error.strerror or error})') from error
    return opened


def net_ft_sensor(settings: ForceTorqueSettings, clock: Clock, host: str) -> StreamedForceTorque:
    """The box at an address, not open yet.

    Raises:
        ConfigurationError: it is no name or IPv4 address, or has a port in it.
    """
    if not re.fullmatch(r'[\w-]{1,63}(\.[\w-]{1,63})*', host):
        raise ConfigurationError(
            f'{host!r} is not an address of a Net F/T box; use netft://192.168.1.1, and for ports net_ft.rdt_port and '
            'net_ft.http_port'
        )
    return StreamedForceTorque(
        f'the Net F/T box at {host}', lambda: NetFtConnection(host, settings, clock), settings, clock, AXES
    )
