"""The last known state of a machine, written to disk for the next process that commands it.

A file of JSON lines for each machine; the last line counts. It is written and synced to disk before anything moves, so
that a kill or a power cut leaves `begun` as the last line: the position of the tip is unknown then.

    {"step": "begun", "stamp_ns": …, "reason": "plan 0f3a… in /data/gel"}
    {"step": "halted", "stamp_ns": …, "reason": "the force is 6.02 N, more than the bearable 5 N"}
    {"step": "acknowledged", "stamp_ns": …, "reason": ""}
    {"step": "ended", "stamp_ns": …, "reason": ""}
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

from tactile_nodes.drivers.cnc.contract import SIMULATED
from tactile_nodes.drivers.serial_port import lasting_name
from tactile_nodes.errors import ConfigurationError, TactileError
from tactile_nodes.files import read_plain
from tactile_nodes.paths import state_directory

BEGUN, HALTED, ACKNOWLEDGED, ENDED = 'begun', 'halted', 'acknowledged', 'ended'
"""The machine moves from now on; the force was too large, a person must check; a person has checked; the tip is up."""
_LARGEST_BYTES = 64 << 20  # some 100 000 runs


class MachineRecord:
    """The record of one machine.

    Args:
        path: its file; None for a machine that is new with each process: nothing is stored.

    Raises:
        ConfigurationError: the file cannot be read.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._step, self._begun, self._halt = '', '', ''
        for line in self._lines():
            try:
                found = json.loads(line)
                self._take(str(found['step']), str(found['reason']))
            except (ValueError, TypeError, KeyError):
                self._take(BEGUN, '')  # an incomplete line: the machine was about to move, or moved

    @property
    def halted(self) -> bool:
        """Whether a run was halted, and no person has acknowledged that."""
        return self._step == HALTED

    def question(self, unasked: bool) -> str:
        """The question to a person before anything moves; empty: none.

        Args:
            unasked: whether a person has allowed in advance to continue after a run that was cut off, not after a halt.
        """
        if self.halted:
            return f'the run was halted: {self._halt}'
        if self._step in {BEGUN, ACKNOWLEDGED} and not unasked:
            which = f' ({self._begun})' if self._begun else ''
            return f'the run before this one{which} was cut off, so the position of the tip is unknown'
        return ''

    def note(self, step: str, stamp_ns: int, reason: str = '') -> None:
        """Write a step; it is on the disk when this returns.

        Raises:
            TactileError: it cannot be written to disk.
        """
        if self._path is not None:
            line = json.dumps({'step': step, 'stamp_ns': stamp_ns, 'reason': reason}) + '\n'
            _append(self._path, line.encode('ascii'))
        self._take(step, reason)

    def halt(self, stamp_ns: int, reason: str) -> None:
        """Note that a person must check, unless that is noted already. Raises as `note`."""
        if not self.halted:
            self.note(HALTED, stamp_ns, reason)

    def _take(self, step: str, reason: str) -> None:
        """Only a person's acknowledgement ends a halt. A lifted tip or an incomplete line does not."""
        if self.halted and step != ACKNOWLEDGED:
            return
        self._step = step
        if step == BEGUN:
            self._begun = reason
        elif step == HALTED:
            self._halt = reason

    def _lines(self) -> list[bytes]:
        if self._path is None:
            return []
        try:
            return read_plain(self._path, _LARGEST_BYTES).splitlines()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise ConfigurationError(
                f'cannot read the record of the machine {self._path}: {error.strerror}; see where its tip is, then '
                'delete that file'
            ) from error


def record_file(source: str, folder: Path | None) -> Path | None:
    """Where the record of a machine is stored: below `state_directory`, by the persistent name of its port.

    A simulated machine is new in each process. It has a record only if there is a folder of a collection, so that it
    asks the same questions there as a real machine.
    """
    if source == SIMULATED:
        return folder / 'simulated_machine.record' if folder else None
    name = lasting_name(source)
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    return state_directory() / 'machines' / f'{Path(name).name[:100]}-{digest}.jsonl'


def _append(path: Path, line: bytes) -> None:
    """Write a complete line, even after an incomplete one."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open('ab+') as opened:
            if opened.tell():
                opened.seek(-1, os.SEEK_END)
                line = line if opened.read(1) == b'\n' else b'\n' + line
            opened.write(line)
            opened.flush()
            os.fsync(opened.fileno())
    except OSError as error:
        raise TactileError(
            f'cannot write the record of the machine {path}: {error.strerror}; the machine does not move without it'
        ) from error
