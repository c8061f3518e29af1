"""What is reported of a serial port that is not there, or no more."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import serial
from jumping_clock import JumpingClock

from tactile_nodes.drivers import serial_port
from tactile_nodes.errors import DeviceLostError, DeviceNotFoundError


@pytest.mark.parametrize(
    ('listed', 'words'),
    [([], 'no port is listed .* remove brltty'), (['/dev/serial/by-id/usb-a'], 'found: /dev/serial/by-id/usb-a$')],
)
def test_a_port_that_is_missing_names_those_that_are_there_or_what_takes_them(
    listed: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_port, '_by_id', lambda: listed)
    with pytest.raises(DeviceNotFoundError, match=f'there is no serial port .*; {words}'):
        serial_port.open_port(str(tmp_path / 'ttyUSB0'), 115_200, 'default', JumpingClock(0))


@pytest.mark.parametrize(('policy', 'high'), [('default', True), ('low', False)])
def test_a_policy_sets_both_lines_of_a_port(policy: str, high: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """RTS alone holds an ESP32 in reset, DTR alone makes it start its loader."""
    seen: list[tuple[bool, bool]] = []

    def opened(port: serial.Serial) -> None:
        seen.append((port.dtr, port.rts))
        raise serial.SerialException('seen enough')

    monkeypatch.setattr(serial.Serial, 'open', opened)
    with pytest.raises(DeviceNotFoundError):
        serial_port.open_port('/dev/null', 115_200, policy, JumpingClock(0))
    assert seen == [(high, high)]


@pytest.mark.parametrize(
    ('said', 'told'),
    [
        ('device reports readiness to read but returned no data', 'unplugged, or read by another program'),
        ('read failed: [Errno 5] Input/output error', 'read failed: .* Input/output error'),
    ],
)
def test_a_port_that_is_lost_says_why(said: str, told: str) -> None:
    def fail(_: object) -> bytes:
        raise serial.SerialException(said)

    system: Any = SimpleNamespace(read=fail, write=fail)
    port = serial_port.SerialPort(system, '/dev/tty9')
    for use in (lambda: port.read(0.1), lambda: port.write(b'?')):
        with pytest.raises(DeviceLostError, match=rf'/dev/tty9 is gone \({told}\); check its cable'):
            use()
