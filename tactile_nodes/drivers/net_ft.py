"""An ATI Net F/T box: every record over UDP, in N and N·m, stamped by the box's own sample counter.

The box stops by itself when this host dies: it is asked for a finite number of records, and asked again before they
are sent. Nothing in the box is changed: no bias (tare on the host instead, `force_torque_tare`), no filter; the output
rate only if the settings say so.
"""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Mapping

from tactile_nodes import clock as clocks
from tactile_nodes.clock import Clock
from tactile_nodes.drivers import net_ft_config as configs
from tactile_nodes.drivers import net_ft_rdt as rdt
from tactile_nodes.drivers.force_torque import AXES, Flag, ForceTorqueSettings
from tactile_nodes.drivers.force_torque_clock import TickClock
from tactile_nodes.drivers.force_torque_queue import SampleQueue
from tactile_nodes.drivers.force_torque_stream import StreamedForceTorque
from tactile_nodes.drivers.net_ft_config import INTERNAL_RATE_HZ, BoxConfig
from tactile_nodes.drivers.net_ft_status import flags_of
from tactile_nodes.errors import ConfigurationError, DeviceError, DeviceNotFoundError, DeviceTimeoutError

RECEIVE_BUFFER = 4 << 20  # five seconds of records at 7000 Hz, bookkeeping of the kernel included
WAIT_S = 0.05
TRY_S = 0.1
RETRIES_OF_RENEWAL = 20
LARGEST_DATAGRAM = 65_535


class NetFtConnection:
    """A box that streams to us.

    Raises:
        DeviceError: as `net_ft_config.read_config`; or RDT is switched off in the box.
        DeviceTimeoutError: it does not start.
    """

    def __init__(self, host: str, settings: ForceTorqueSettings, clock: Clock) -> None:
        self._host = host
        self._settings = settings
        self._clock = clock
        self.config = _configured(host, settings)
        self.tracker = rdt.StreamTracker()
        self._ticks = self._new_clock()
        self._stalls = 0
        self._renew_at_s = 0.0
        self._tries = 0
        self._first: tuple[bytes, int] | None = None
        self._socket = _socket(host, settings.net_ft.rdt_port)
        try:
            self._start()
        except BaseException:
            self._socket.close()
            raise

    @property
    def rate_hz(self) -> float:
        """As the box's counters show; before that, as the box says."""
        return INTERNAL_RATE_HZ / self.tracker.step if self.tracker.step else self.config.rate_hz

    @property
    def description(self) -> Mapping[str, str]:
        """The box's configuration and what became of its records."""
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
            'clock drift': f'{self._ticks.drift_ppm:+.0f} ppm',
            'records lost, doubled, late, malformed': f'{counters.lost}, {counters.duplicates}, '
            f'{counters.out_of_order}, {counters.malformed}',
            'times stalled': str(self._stalls),
        }

    @property
    def complaint(self) -> str:
        """A rate that is not the one asked for, or a bias set by somebody else."""
        asked = self._settings.rate_hz
        if asked > 0 and self.rate_hz and not _near(asked, self.rate_hz):
            return f'asked for {asked:g} samples/s, the box gives {self.rate_hz:.0f}; see its Communications page'
        return ''

    def fetch(self, queue: SampleQueue) -> None:
        """Receive a datagram, and renew the request when it is time."""
        if clocks.monotonic_s() >= self._renew_at_s:
            self._renew()
        datagram, self._first = (self._first or self._receive()), None
        if datagram is None:
            return
        data, arrival_ns = datagram
        records = rdt.records(data)
        if records is None:
            self.tracker.counters.malformed += 1
            return
        expecting = not self.tracker.renewed
        for record in records:
            self._put(record, arrival_ns, queue)
        if expecting and self.tracker.renewed:
            self._tries, self._renew_at_s = 0, clocks.monotonic_s() + self._settings.net_ft.renew_s

    def close(self) -> None:
        """Have the box stop; it would by itself."""
        with contextlib.suppress(OSError):
            self._socket.send(rdt.request(rdt.STOP))
        self._socket.close()

    def _put(self, record: rdt.Record, arrival_ns: int, queue: SampleQueue) -> None:
        accepted = self.tracker.accept(record)
        if accepted is None:
            return
        flags = flags_of(record.status)
        if accepted.rebooted:
            self._ticks = self._new_clock()
            flags |= Flag.RESTARTED
        if accepted.stalled:
            self._stalls += 1
            flags |= Flag.STALLED
        ticks = self._ticks.unwrapped(record.ft_sequence)
        stamp_ns = self._ticks.stamp(ticks, arrival_ns)
        if not self._ticks.settled and not accepted.stalled:
            return
        a, b, c, d, e, f = (
            count * unit for count, unit in zip(record.counts, self.config.units_per_count, strict=True)
        )
        queue.put(
            (a, b, c, d, e, f), record.counts, stamp_ns, arrival_ns, ticks, flags, record.status, accepted.missing
        )

    def _new_clock(self) -> TickClock:
        return TickClock(INTERNAL_RATE_HZ, delay_ns=round(self._settings.delay_ms * 1e6))

    def _start(self) -> None:
        """Ask until a record comes: the box acknowledges nothing, and a request can get lost."""
        self._socket.settimeout(TRY_S)
        for _ in range(self._settings.net_ft.start_tries):
            self._request()
            if (datagram := self._receive()) is not None:
                self._first = datagram
                self._socket.settimeout(WAIT_S)
                return
        raise DeviceTimeoutError(
            f'the box at {self._host} sends no records to port {self._settings.net_ft.rdt_port} requests; check that '
            'no firewall holds UDP back and that no other program uses the box'
        )

    def _renew(self) -> None:
        """Ask again; and again soon, a number of times, until the new stream is seen to begin."""
        self._request()
        self._tries += 1
        if self._tries >= RETRIES_OF_RENEWAL:
            self._tries, self._renew_at_s = 0, clocks.monotonic_s() + self._settings.net_ft.renew_s

    def _request(self) -> None:
        self.tracker.requested()
        net_ft = self._settings.net_ft
        count = math.ceil(net_ft.count_s * (self.rate_hz or INTERNAL_RATE_HZ))
        command = rdt.START_BUFFERED if net_ft.buffered else rdt.START_REALTIME
        with contextlib.suppress(ConnectionRefusedError):  # the answer to an earlier one: nobody listens there now
            self._socket.send(rdt.request(command, count))
        self._renew_at_s = clocks.monotonic_s() + TRY_S

    def _receive(self) -> tuple[bytes, int] | None:
        try:
            data = self._socket.recv(LARGEST_DATAGRAM)
        except (TimeoutError, ConnectionRefusedError):
            return None
        return data, self._clock.now_ns()


def _near(asked: float, given: float) -> bool:
    return asked <= given * 1.001 and given <= INTERNAL_RATE_HZ / max(1, INTERNAL_RATE_HZ // asked) * 1.001


def _configured(host: str, settings: ForceTorqueSettings) -> BoxConfig:
    port = settings.net_ft.http_port
    config = configs.read_config(host, port)
    if settings.net_ft.set_rate and settings.rate_hz > 0 and not _near(settings.rate_hz, config.rate_hz):
        configs.set_rate(host, port, settings.rate_hz, config.axia)
        config = configs.read_config(host, port)
    if not config.enabled:
        raise DeviceError(f'RDT is switched off in the box at {host}; enable it on its Communications page')
    return config


def _socket(host: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        opened.connect((host, port))  # from now on only what this box sends is received
    except OSError as error:
        opened.close()
        raise DeviceNotFoundError(f'cannot reach the box at {host} ({error.strerror or error})') from error
    return opened


def net_ft_sensor(settings: ForceTorqueSettings, clock: Clock, host: str) -> StreamedForceTorque:
    """The box at an address, not open yet.

    Raises:
        ConfigurationError: the address has a port in it.
    """
    if not host or '/' in host or ':' in host:
        raise ConfigurationError(
            f'{host!r} is no address of a Net F/T box; write netft://192.168.1.1, and ports as net_ft.rdt_port and '
            'net_ft.http_port'
        )
    return StreamedForceTorque(
        f'the Net F/T box at {host}', lambda: NetFtConnection(host, settings, clock), settings, clock, AXES
    )
