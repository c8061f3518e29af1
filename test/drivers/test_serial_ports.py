"""What is reported of a serial port that is not there."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from jumping_clock import JumpingClock

from tactile_nodes.drivers import serial_port
from tactile_nodes.errors import DeviceNotFoundError


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
