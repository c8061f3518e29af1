"""How processes of one host and one domain find each other: a folder that only this user may enter.

Each participant keeps three kinds of files in ``<run folder>/d<domain>/``: ``<uid>.json`` says what it offers and
receives, ``<uid>.lock`` is held locked for as long as it lives, and ``<uid>.<n>.sock`` are its sockets. The kernel
gives up the lock when the process ends, however it ends, so a participant is alive exactly while its lock is held:
there are no heartbeats to miss and no broker to lose. Whoever meets the files of a dead one removes them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import stat
import threading
import weakref
from pathlib import Path

from tactile_nodes import clock
from tactile_nodes.bus.zeromq.records import LONGEST_TEXT, Record
from tactile_nodes.errors import BusError, ConfigurationError
from tactile_nodes.paths import is_short_enough, run_directory

LOOK_EVERY_S = 0.05
_OWN_FILE = re.compile(r'(?P<uid>[0-9a-f]{8})\.(lock|json|\d+\.sock)')


def domain_from_environment() -> int:
    """``ROS_DOMAIN_ID``, 0 when it is not set.

    Raises:
        ConfigurationError: it is no number from 0 to 232.
    """
    text = os.environ.get('ROS_DOMAIN_ID', '').strip() or '0'
    if not text.isdecimal() or int(text) > 232:
        raise ConfigurationError(f'ROS_DOMAIN_ID is {text!r}; set it to a number from 0 to 232')
    return int(text)


class Meeting:
    """This participant's place in the folder of its domain, and its view of the others.

    Raises:
        BusError, ConfigurationError: the folder cannot be used.
    """

    def __init__(self, uid: str, domain_id: int, folder: Path | None = None) -> None:
        self.uid = uid
        self.malformed = 0
        self._base = folder
        self._domain_id = domain_id
        self._records: dict[str, tuple[int, Record | None]] = {}
        self._writing = threading.Lock()
        self._reading = threading.Lock()
        self._written_ns = self._announced_ns = 0
        self._lock = -1
        self.enter()
        _at_fork(self)

    def enter(self) -> None:
        """Take our place in the folder; once more after somebody has removed it.

        Raises:
            BusError, ConfigurationError: the folder cannot be used.
        """
        self.folder = self._meeting_place()
        base = self.folder.parent
        if not is_short_enough(base):
            raise BusError(f'the path {base} is too long for sockets; set TACTILE_RUN_DIR to a shorter path')
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            taken = self._take_lock()
        except OSError as error:
            raise BusError(f'cannot join the bus in {self.folder}: {error.strerror}; is the disk full?') from error
        self.let_go()
        self._lock = taken
        clock.keep_anchor()
        self._sweep()

    def is_present(self) -> bool:
        """Whether the others see us; false if our files were removed, or if new processes now use another folder.

        Raises:
            ConfigurationError: that folder cannot be used.
        """
        try:
            found = (self.folder / f'{self.uid}.lock').stat()
            return found.st_ino == os.fstat(self._lock).st_ino and self.folder == self._meeting_place()
        except OSError:
            return False

    def is_announced(self) -> bool:
        """Whether the others can read what we said last; false when it was removed or written over."""
        with self._writing:
            try:
                return (self.folder / f'{self.uid}.json').stat().st_mtime_ns == self._announced_ns
            except OSError:
                return False

    def socket_address(self, number: int) -> str:
        """An ipc:// address of our own."""
        return f'ipc://{self.folder}/{self.uid}.{number}.sock'

    def announce(self, record: Record) -> None:
        """Say what we offer and receive; the others notice within `LOOK_EVERY_S`.

        Raises:
            BusError: the disk is full, or the folder is gone.
        """
        draft = self.folder / f'.{self.uid}.json'
        with self._writing:
            # File stamps are as coarse as 4 ms; readers tell a new text by its stamp, so each gets one of its own.
            self._written_ns = max(self._written_ns + 1, clock.wall_ns())
            self._announced_ns = -1  # until the record is written, nothing is announced
            try:
                draft.write_text(record.to_json(), encoding='utf-8')
                os.utime(draft, ns=(self._written_ns, self._written_ns))
                self._announced_ns = draft.stat().st_mtime_ns  # as coarse as this file system has it
                draft.rename(self.folder / f'{self.uid}.json')
            except OSError as error:
                raise BusError(f'cannot announce this process on the bus in {self.folder}: {error.strerror}') from error

    def look(self, *, trusting: bool = False) -> list[Record]:
        """The records of all living participants but us; those of dead ones are cleared away.

        `trusting` takes those who were alive the last time to be so still, which saves most of the time.
        """
        with self._reading:
            present = self._listed()
            if self.uid in present:
                self._records = {uid: record for uid, record in self._records.items() if uid in present}
                found = [self._meet(uid, trusting) for uid in sorted(present - {self.uid})]
            else:  # our own files were removed, too: the folder does not tell who is gone
                found = [record for _, record in self._records.values()]
        return [record for record in found if record is not None]

    def changed_ns(self) -> int:
        """A number that changes whenever somebody comes, goes or says something new."""
        try:
            return self.folder.stat().st_mtime_ns
        except OSError:
            return -1

    def leave(self) -> None:
        """Remove our files and let go of the lock."""
        with self._writing:
            self._clear(self.uid)
            self.let_go()

    def let_go(self) -> None:
        """Close the lock's descriptor; a forked child does it too, lest it keep its dead parent alive."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _meeting_place(self) -> Path:
        """The folder of the domain. The last logout removes that of a login, and the next login makes it again."""
        return (self._base or run_directory()).absolute() / f'd{self._domain_id}'

    def _meet(self, uid: str, trusting: bool) -> Record | None:
        if (trusting and uid in self._records) or self._is_alive(uid):
            return self._read(uid)
        self._clear(uid)
        self._records.pop(uid, None)
        return None

    def _take_lock(self) -> int:
        draft = self.folder / f'.{self.uid}.lock'
        descriptor = os.open(draft, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            draft.rename(self.folder / f'{self.uid}.lock')  # in sight only once it is locked
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    def _listed(self, ending: str = '.lock') -> set[str]:
        found = (_OWN_FILE.fullmatch(name) for name in self._names() if name.endswith(ending))
        return {match['uid'] for match in found if match}

    def _names(self) -> list[str]:
        try:
            return os.listdir(self.folder)  # noqa: PTH208 - names are enough, and a tenth of the time
        except OSError:
            return []

    def _is_alive(self, uid: str) -> bool:
        try:
            # Without O_NONBLOCK, somebody's named pipe would hold us up for ever.
            descriptor = os.open(self.folder / f'{uid}.lock', os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
        finally:
            os.close(descriptor)
        return False

    def _read(self, uid: str) -> Record | None:
        file = self.folder / f'{uid}.json'
        try:
            found = file.stat()
            if uid in self._records and self._records[uid][0] == found.st_mtime_ns:
                return self._records[uid][1]
            record: Record | None = self._parsed(uid, file, found)
        except FileNotFoundError:  # it has come and not spoken yet, or its record was removed and it will speak again
            return self._earlier_record(uid)
        except (OSError, ValueError):
            self.malformed += 1
            record = self._earlier_record(uid)
        self._records[uid] = (found.st_mtime_ns, record)
        return record

    def _earlier_record(self, uid: str) -> Record | None:
        """What a living participant said before."""
        return self._records.get(uid, (0, None))[1]

    def _parsed(self, uid: str, file: Path, found: os.stat_result) -> Record:
        if not stat.S_ISREG(found.st_mode) or found.st_size > LONGEST_TEXT:
            raise ValueError('no file of a participant')
        record = Record.from_json(file.read_text(encoding='utf-8'), f'ipc://{self.folder}/{uid}')
        if record.participant.uid != uid:
            raise ValueError('a record of somebody else')
        return record

    def _sweep(self) -> None:
        """Remove what was left by processes that ended while others cleared away after them."""
        for uid in self._listed('') - self._listed():
            self._clear(uid)

    def _clear(self, uid: str) -> None:
        # The lock goes last: as long as it is there, somebody will come and finish this.
        names = [name for name in self._names() if name.startswith((f'{uid}.', f'.{uid}.'))]
        for name in sorted(names, key=lambda name: name.endswith('.lock')):
            with contextlib.suppress(OSError):  # gone already, or no file at all: not ours to mend
                (self.folder / name).unlink()


def _at_fork(meeting: Meeting) -> None:
    still = weakref.ref(meeting)

    def in_child() -> None:
        parents = still()
        if parents is not None:
            parents.let_go()

    os.register_at_fork(after_in_child=in_child)
