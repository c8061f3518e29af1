"""What is known of a machine after whatever became of the process that commanded it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tactile_nodes.collection.machine_record import ACKNOWLEDGED, BEGUN, ENDED, HALTED, MachineRecord, record_file
from tactile_nodes.drivers import serial_port
from tactile_nodes.errors import ConfigurationError, TactileError

CUT_OFF = 'the run before this one (plan 7 in /data) was cut off, so the position of the tip is unknown'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'machines' / 'one.jsonl'


def noted(file: Path, *steps: str) -> None:
    record = MachineRecord(file)
    for step in steps:
        record.note(step, 10, {BEGUN: 'plan 7 in /data', HALTED: 'the force is 6 N'}.get(step, ''))


@pytest.mark.parametrize(
    ('steps', 'question', 'unasked'),
    [
        ((), '', ''),
        ((BEGUN, ENDED), '', ''),
        ((BEGUN,), CUT_OFF, ''),
        ((BEGUN, HALTED, ACKNOWLEDGED), CUT_OFF, ''),
        ((BEGUN, HALTED), 'the run was halted: the force is 6 N', 'the run was halted: the force is 6 N'),
        ((BEGUN, HALTED, ENDED), 'the run was halted: the force is 6 N', 'the run was halted: the force is 6 N'),
        ((BEGUN, HALTED, ACKNOWLEDGED, ENDED), '', ''),
    ],
    ids=lambda value: '-'.join(value) if isinstance(value, tuple) else None,
)
def test_the_next_process_asks_what_has_to_be_asked(
    file: Path, steps: tuple[str, ...], question: str, unasked: str
) -> None:
    noted(file, *steps)
    assert MachineRecord(file).question(unasked=False) == question
    assert MachineRecord(file).question(unasked=True) == unasked


@pytest.mark.parametrize('left', [1, 20, 40])
def test_a_line_that_was_cut_off_says_that_it_was_about_to_move(file: Path, left: int) -> None:
    noted(file, BEGUN, ENDED, BEGUN)
    complete = file.read_bytes()
    last = complete.splitlines(keepends=True)[-1]
    file.write_bytes(complete[: len(complete) - len(last) + left])
    assert 'was cut off' in MachineRecord(file).question(unasked=False)
    noted(file, ENDED)  # on a line of its own
    assert MachineRecord(file).question(unasked=False) == ''


def test_half_of_a_line_answers_no_halt(file: Path) -> None:
    noted(file, BEGUN, HALTED)
    with file.open('ab') as opened:
        opened.write(b'{"step": "ackn')
    assert 'halted' in MachineRecord(file).question(unasked=True)


def test_a_record_that_cannot_be_kept_lets_nothing_move(tmp_path: Path) -> None:
    record = MachineRecord(tmp_path / 'machines' / 'one.jsonl')
    (tmp_path / 'machines').write_text('a file where the folder should be')
    with pytest.raises(TactileError, match='the machine does not move without it'):
        record.note(BEGUN, 10)


def test_a_record_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'one.jsonl')
    with pytest.raises(ConfigurationError, match=r'cannot read the record of the machine .*see where its tip is'):
        MachineRecord(tmp_path / 'one.jsonl')


def test_one_machine_has_one_record_by_whatever_name_its_port_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'ttyUSB0').touch()
    lasting = tmp_path / 'usb-FTDI_A900-if00-port0'
    lasting.symlink_to('ttyUSB0')
    monkeypatch.setattr(serial_port, '_by_id', lambda: [str(lasting)])
    names = [record_file(str(tmp_path / name), None) for name in ('ttyUSB0', lasting.name, 'ttyUSB1')]
    assert names[0] == names[1] != names[2]
    assert names[0] is not None and names[0].name.startswith('usb-FTDI_A900-if00-port0-')


def test_a_port_named_by_its_place_keeps_that_name_though_two_adapters_share_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A CH340 has no serial number: the name of two of them leads to the one that the system found last."""
    place, shared = tmp_path / 'by-path' / 'pci-usb-0:2:1.0-port0', tmp_path / 'usb-1a86_USB_Serial-if00-port0'
    place.parent.mkdir()
    place.symlink_to('../ttyUSB0')
    monkeypatch.setattr(serial_port, '_by_id', lambda: [str(shared)])
    names = []
    for found_last in ('ttyUSB0', 'ttyUSB1'):
        shared.symlink_to(found_last)
        names.append(record_file(str(place), None))
        shared.unlink()
    assert names[0] == names[1]


def test_a_port_that_is_a_link_keeps_its_name_when_it_leads_elsewhere(tmp_path: Path) -> None:
    """As a pseudo terminal of an emulator has another number each time."""
    (tmp_path / 'cnc').symlink_to('/dev/null')
    first = record_file(str(tmp_path / 'cnc'), None)
    (tmp_path / 'cnc').unlink()
    (tmp_path / 'cnc').symlink_to('/dev/zero')
    assert record_file(str(tmp_path / 'cnc'), None) == first


def test_a_simulated_machine_is_new_with_each_process_but_in_the_folder_of_a_collection(tmp_path: Path) -> None:
    assert record_file('simulated', None) is None
    MachineRecord(None).note(BEGUN, 10)
    assert record_file('simulated', tmp_path) == tmp_path / 'simulated_machine.record'
