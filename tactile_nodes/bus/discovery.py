"""How processes of one host and one domain find each other: a folder that only this user may enter.

Each participant keeps three kinds of files in ``<run folder>/d<domain>/``: ``<uid>.json`` says what it offers and
receives, ``<uid>.lock`` is held locked for as long as it lives, and ``<uid>.<n>.sock`` are its sockets. The kernel
gives up the lock when the process ends, however it ends, so a participant is alive exactly while its lock is held:
there are no heartbeats to miss and no broker to lose. Whoever meets the files of a dead one removes them.
"""

from __future__ import annotations

import fcntl
import json
import os
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactile_nodes.bus.protocol import Endpoint, Participant
from tactile_nodes.errors import BusError, ConfigurationError
from tactile_nodes.paths import run_directory

LOOK_EVERY_S = 0.05
FORMAT = 1
_LONGEST_SOCKET_PATH = 107  # sockaddr_un.sun_path holds 108 bytes, the last one a NUL


def domain_from_environment() -> int:
    """``ROS_DOMAIN_ID``, 0 when it is not set.

    Raises:
        ConfigurationError: it is no number from 0 to 232.
    """
    text = os.environ.get('ROS_DOMAIN_ID', '').strip() or '0'
    if not text.isdecimal() or int(text) > 232:
        raise ConfigurationError(f'ROS_DOMAIN_ID is {text!r}; set it to a number from 0 to 232')
    return int(text)


@dataclass(frozen=True)
class Record:
    """What one participant says of itself, with the addresses that only the transport needs.

    `addresses` maps 'publisher gid' to its address; `service_address` is where its services answer.
    """

    participant: Participant
    addresses: Mapping[str, str]
    gids: tuple[str, ...]
    service_address: str

    def to_json(self) -> str:
        return json.dumps(
            {
                'format': FORMAT,
                'participant': asdict(self.participant),
                'addresses': dict(self.addresses),
                'gids': self.gids,
                'service_address': self.service_address,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Record:
        """Raises ValueError, KeyError or TypeError when `text` is no record."""
        fields = json.loads(text)
        if fields['format'] != FORMAT:
            raise ValueError(f'format {fields["format"]}')
        peer: dict[str, Any] = fields['participant']
        for role in ('publishers', 'subscriptions', 'services'):
            peer[role] = tuple(Endpoint(**end) for end in peer[role])
        peer['nodes'] = tuple(str(node) for node in peer['nodes'])
        addresses = {str(gid): str(address) for gid, address in fields['addresses'].items()}
        return cls(Participant(**peer), addresses, tuple(map(str, fields['gids'])), str(fields['service_address']))


class Meeting:
    """This participant's place in the folder of its domain, and its view of the others."""

    def __init__(self, uid: str, domain_id: int, folder: Path | None = None) -> None:
        self.uid = uid
        self.folder = (folder or run_directory()) / f'd{domain_id}'
        self.malformed = 0
        self._records: dict[str, tuple[int, Record | None]] = {}
        self._writing = threading.Lock()
        self._reading = threading.Lock()
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._lock = self._take_lock()
        except OSError as error:
            raise BusError(f'cannot join the bus in {self.folder}: {error.strerror}; is the disk full?') from error

    def socket_address(self, number: int) -> str:
        """An ipc:// address of our own.

        Raises:
            BusError: the folder's name is too long for a socket.
        """
        path = self.folder / f'{self.uid}.{number}.sock'
        if len(os.fsencode(path)) > _LONGEST_SOCKET_PATH:
            raise BusError(f'{path} is too long for a socket; set TACTILE_RUN_DIR to a folder with a shorter name')
        return f'ipc://{path}'

    def announce(self, record: Record) -> None:
        """Say what we offer and receive; the others notice within `LOOK_EVERY_S`."""
        draft = self.folder / f'.{self.uid}.json'
        with self._writing:
            try:
                draft.write_text(record.to_json(), encoding='utf-8')
                draft.rename(self.folder / f'{self.uid}.json')
            except OSError as error:
                raise BusError(f'cannot tell the others on the bus in {self.folder}: {error.strerror}') from error

    def look(self) -> list[Record]:
        """The records of all living participants but us; those of dead ones are cleared away."""
        with self._reading:
            found = [self._meet(uid) for uid in sorted(self._listed() - {self.uid})]
        return [record for record in found if record is not None]

    def changed_ns(self) -> int:
        """A number that changes whenever somebody comes, goes or says something new."""
        return self.folder.stat().st_mtime_ns

    def leave(self) -> None:
        """Remove our files and let go of the lock."""
        with self._writing:
            self._clear(self.uid)
            os.close(self._lock)

    def _meet(self, uid: str) -> Record | None:
        if self._is_alive(uid):
            return self._read(uid)
        self._clear(uid)
        self._records.pop(uid, None)
        return None

    def _take_lock(self) -> int:
        draft = self.folder / f'.{self.uid}.lock'
        descriptor = os.open(draft, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        draft.rename(self.folder / f'{self.uid}.lock')  # in sight only once it is locked
        return descriptor

    def _listed(self) -> set[str]:
        return {file.stem for file in self.folder.glob('[!.]*.lock')}

    def _is_alive(self, uid: str) -> bool:
        try:
            descriptor = os.open(self.folder / f'{uid}.lock', os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(descriptor)
        return False

    def _read(self, uid: str) -> Record | None:
        file = self.folder / f'{uid}.json'
        try:
            written_ns = file.stat().st_mtime_ns
            if uid in self._records and self._records[uid][0] == written_ns:
                return self._records[uid][1]
            record: Record | None = Record.from_json(file.read_text(encoding='utf-8'))
        except FileNotFoundError:  # it has come and not spoken yet
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            self.malformed += 1
            record = None
        self._records[uid] = (written_ns, record)
        return record

    def _clear(self, uid: str) -> None:
        for file in self.folder.glob(f'{uid}.*'):
            file.unlink(missing_ok=True)
