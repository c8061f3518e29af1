"""A serial port: finding it, opening it with a policy for its DTR line, reading, and detecting its removal.

Many controllers have their reset wired to DTR, some so that an open port keeps them in reset. So there is a setting
for that line:

=============  =====================================================================================
``default``    raised on opening, as usual: Arduino-like boards restart
``pulse``      lowered for 0.1 s after opening, then raised: these boards certainly restart
``low``        lowered right after opening and kept low, with RTS: for boards in reset while it is high
``untouched``  not changed, not even on closing: the controller keeps its position if the system allows it
=============  =====================================================================================
"""

from __future__ import annotations

import contextlib
import os
import termios
from pathlib import Path
from typing import Protocol

import serial

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import ConfigurationError, DeviceBusyError, DeviceError, DeviceLostError, DeviceNotFoundError

DTR_POLICIES = ('default', 'pulse', 'low', 'untouched')
PULSE_NS = NS_PER_S // 10
WRITE_TIMEOUT_S = 1.0


class Port(Protocol):
    """Bytes to and from a device; `name` is for errors."""

    name: str

    def write(self, data: bytes) -> None:
        """Send.

        Raises:
            DeviceLostError: it is gone, or accepts no more data.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """The received bytes, at once if there are any; empty after the timeout.

        Raises:
            DeviceLostError: it is gone.
        """
        ...

    def close(self) -> None:
        """Close it."""
        ...


class SerialPort(Port):
    """A port of the operating system, opened exclusively."""

    def __init__(self, port: serial.Serial, name: str) -> None:
        self._port = port
        self.name = name

    @property
    def descriptor(self) -> int:
        """File descriptor of the open port."""
        number: int = self._port.fileno()
        return number

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed by another thread
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> bytes:
        try:
            self._port.timeout = timeout_s
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b''
        except (serial.SerialException, OSError, TypeError, termios.error) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        with contextlib.suppress(serial.SerialException, OSError):
            self._port.close()

    def _lost(self, error: Exception) -> DeviceLostError:
        return DeviceLostError(f'{self.name} is gone ({_why(error)}); check its cable and reconnect it')


def _why(error: Exception) -> str:
    return 'unplugged, or read by another program' if 'returned no data' in str(error) else str(error)


def open_port(path: str, baud: int, dtr: str, clock: Clock) -> SerialPort:
    """Open a port.

    Args:
        path: a device, preferably from /dev/serial/by-id, where names do not change.
        baud: bits per second.
        dtr: one of `DTR_POLICIES`.
        clock: times the pulse.

    Raises:
        ConfigurationError: no such policy or baud rate.
        DeviceNotFoundError: no such port, or no permission to open it.
        DeviceBusyError: another program uses it.
    """
    if dtr not in DTR_POLICIES:
        raise ConfigurationError(f'no DTR policy {dtr!r}; available: {", ".join(DTR_POLICIES)}')
    if not Path(path).exists():
        raise DeviceNotFoundError(f'there is no serial port {path}; {_there_are()}')
    port = serial.Serial(baudrate=baud, timeout=0.0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
    port.port = path
    port.dsrdtr = dtr == 'untouched'  # then pyserial does not change the line
    port.dtr = port.rts = dtr != 'low'  # an ESP32 board is in reset while RTS alone is high
    try:
        port.open()
    except (serial.SerialException, OSError) as error:
        raise _cannot_open(path, error) from error
    except ValueError as error:
        raise ConfigurationError(f'cannot open {path} with {baud} baud ({error}); use another rate') from error
    with contextlib.suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)  # otherwise FTDI adapters delay bytes by 16 ms; others do not need it
    if dtr == 'untouched':
        _keep_line_on_close(port.fileno())
    elif dtr == 'pulse':
        _pulse(port, clock)
    return SerialPort(port, path)


def lasting_name(path: str) -> str:
    """The persistent name of a port: below /dev/serial/by-id, if there is one; else the path.

    A path below by-path stays: it is used where adapters without a serial number share a name below by-id.
    """
    if Path(path).parent.name == 'by-path':
        return path
    device = os.path.realpath(path)
    found = (each for each in _by_id() if os.path.realpath(each) == device)
    return next(found, str(Path(path).absolute()))


def _pulse(port: serial.Serial, clock: Clock) -> None:
    with contextlib.suppress(OSError):  # a port without that line, such as a pseudo terminal
        port.dtr = False
        clock.sleep_until(clock.now_ns() + PULSE_NS)
        port.dtr = True


def _keep_line_on_close(descriptor: int) -> None:
    attributes = termios.tcgetattr(descriptor)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def _cannot_open(path: str, error: Exception) -> DeviceError:
    text = str(error).lower()
    if 'permission' in text:
        return DeviceNotFoundError(
            f'no permission to open {path}; add yourself to its group (often dialout) and log in again'
        )
    if 'exclusively lock' in text or 'busy' in text:
        return DeviceBusyError(f'{path} is in use by another program; close that program first')
    return DeviceNotFoundError(f'cannot open {path} as a serial port ({error}); use another one')


def _by_id() -> list[str]:
    return sorted(str(each) for each in Path('/dev/serial/by-id').glob('*'))


def _there_are() -> str:
    found = _by_id()
    nothing = 'no port is listed under /dev/serial/by-id; if one disappears after it is plugged in, remove brltty'
    return f'found: {", ".join(found)}' if found else nothing
