"""A serial port: found, opened with a policy for its DTR line, read in pieces, and gone when it is unplugged.

Many controllers have their reset wired to DTR, some so that a port that is merely open keeps them in reset; so what
happens to that line is a setting:

============  ======================================================================================
``default``   raised on opening, as every program does it: boards of the Arduino kind restart
``pulse``     lowered for 0.1 s after opening, then raised: those boards restart for certain
``low``       lowered right after opening and kept so: for boards that are in reset while it is raised
``untouched`` not touched, nor lowered on closing: the controller keeps its position if the system lets it
============  ======================================================================================
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
    """Bytes to and from a device."""

    @property
    def name(self) -> str:
        """What to call it in an error."""
        ...

    def write(self, data: bytes) -> None:
        """Send.

        Raises:
            DeviceLostError: it is gone, or takes nothing any more.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at once if something has; empty after the timeout.

        Raises:
            DeviceLostError: it is gone.
        """
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class SerialPort:
    """A port of the operating system, held exclusively."""

    def __init__(self, port: serial.Serial, name: str) -> None:
        self._port = port
        self.name = name

    @property
    def descriptor(self) -> int:
        """Of the open port."""
        number: int = self._port.fileno()
        return number

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        try:
            self._port.write(data)
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed by another thread
            raise self._lost(error) from error

    def read(self, timeout_s: float) -> bytes:
        """As `Port.read`."""
        try:
            self._port.timeout = timeout_s
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b''
        except (serial.SerialException, OSError, TypeError, termios.error) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """As `Port.close`."""
        with contextlib.suppress(serial.SerialException, OSError):
            self._port.close()

    def _lost(self, error: Exception) -> DeviceLostError:
        return DeviceLostError(f'{self.name} is gone ({_why(error)}); check its cable and plug it in again')


def _why(error: Exception) -> str:
    return 'unplugged, or read by another program' if 'returned no data' in str(error) else str(error)


def open_port(path: str, baud: int, dtr: str, clock: Clock) -> SerialPort:
    """Open a port.

    Args:
        path: a device, best from /dev/serial/by-id, whose names do not change.
        baud: bits per second.
        dtr: one of `DTR_POLICIES`.
        clock: times the pulse.

    Raises:
        ConfigurationError: no such policy or baud rate.
        DeviceNotFoundError: no such port, or none that this user may open.
        DeviceBusyError: another program has it.
    """
    if dtr not in DTR_POLICIES:
        raise ConfigurationError(f'no DTR policy {dtr!r}; there are {", ".join(DTR_POLICIES)}')
    if not Path(path).exists():
        raise DeviceNotFoundError(f'there is no serial port {path}; {_there_are()}')
    port = serial.Serial(baudrate=baud, timeout=0.0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
    port.port = path
    port.dsrdtr = dtr == 'untouched'  # with which pyserial leaves the line alone
    port.dtr = dtr != 'low'
    try:
        port.open()
    except (serial.SerialException, OSError) as error:
        raise _cannot_open(path, error) from error
    except ValueError as error:
        raise ConfigurationError(f'cannot open {path} with {baud} baud ({error}); give another rate') from error
    with contextlib.suppress(OSError, ValueError, NotImplementedError):
        port.set_low_latency_mode(True)  # FTDI adapters hold bytes back for 16 ms otherwise; others need it not
    if dtr == 'untouched':
        _keep_line_on_close(port.fileno())
    elif dtr == 'pulse':
        _pulse(port, clock)
    return SerialPort(port, path)


def lasting_name(path: str) -> str:
    """The name of a port that stays with its device: below /dev/serial/by-id, where it has one; else the path."""
    device = os.path.realpath(path)
    found = (each for each in _by_id() if os.path.realpath(each) == device)
    return next(found, str(Path(path).absolute()))


def _pulse(port: serial.Serial, clock: Clock) -> None:
    with contextlib.suppress(OSError):  # a port without that line, as a pseudo terminal, has nothing to pulse
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
        return DeviceNotFoundError(f'may not open {path}; add yourself to its group (often dialout) and log in again')
    if 'exclusively lock' in text or 'busy' in text:
        return DeviceBusyError(f'{path} is in use by another program; end that program first')
    return DeviceNotFoundError(f'cannot open {path} as a serial port ({error}); name another one')


def _by_id() -> list[str]:
    return sorted(str(each) for each in Path('/dev/serial/by-id').glob('*'))


def _there_are() -> str:
    found = _by_id()
    return f'there are {", ".join(found)}' if found else 'none is plugged in that has a name under /dev/serial/by-id'
