"""The journal of a plan. It ensures that no press is lost or done twice, however a run ends.

A file of JSON lines: first the plan, then an entry for each step of each press, written and synced to disk before the
run continues. A line that was cut off by a power cut is the last one, and is removed when the journal is opened.

    {"plan": "0f3a…", "presses": 10952, "version": 1}
    {"press": 0, "attempt": 0, "step": "indenter", "stamp_ns": …, "reason": "sphere 1.2 mm"}
    {"press": 17, "attempt": 1, "step": "started", "stamp_ns": …}
    {"press": 17, "attempt": 1, "step": "recorded", "stamp_ns": …}
    {"press": 17, "attempt": 1, "step": "verified", "stamp_ns": …, "reason": "found in the bag"}
    {"press": 0, "attempt": 0, "step": "pattern", "stamp_ns": …}
    {"press": 0, "attempt": 0, "step": "anchored", "stamp_ns": …, "reason": "x +0.01, y -0.00, z +0.01 mm"}
    {"press": 0, "attempt": 0, "step": "ended", "stamp_ns": …}
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tactile_nodes.collection.plan.plan import Plan, Point
from tactile_nodes.errors import ConfigurationError, TactileError
from tactile_nodes.files import read_plain

VERSION = 1
_LARGEST_BYTES = 256 << 20  # a million presses
STARTED, RECORDED, VERIFIED, REJECTED, MISSING = 'started', 'recorded', 'verified', 'rejected', 'missing'
SUSPECT, ANCHORED, ASIDE, BROKEN_OFF = 'suspect', 'anchored', 'aside', 'broken_off'
PATTERN, ENDED, INDENTER = 'pattern', 'ended', 'indenter'
OF_THE_RUN = (PATTERN, ANCHORED, ENDED, INDENTER)
_OF_THE_MACHINE = ('begun', 'halted', 'acknowledged')  # in journals from before each machine had its own record
NO_PRESS = 0
STEPS = (STARTED, RECORDED, VERIFIED, REJECTED, MISSING, SUSPECT, ASIDE, BROKEN_OFF, *OF_THE_RUN, *_OF_THE_MACHINE)
DONE = (RECORDED, VERIFIED)


@dataclass(frozen=True)
class Entry:
    """A step of a press:

    - `started`;
    - `recorded`: sent to the recorder;
    - `verified`: found in the bag;
    - `rejected`: not usable, for the `reason`;
    - `missing`: not found in the bag, or made before the plan was started anew; to be done again;
    - `suspect`: a later anchor was displaced from the one before it; to be done again;
    - `aside`: set aside because the force was too large; not tried again until a run has ended normally, or `anew`;
    - `broken_off`: rejected because a device became silent; tried again.

    Press 0 stands for the run itself. `pattern`: an irregular pattern of the digital line begins. `anchored`:
    everything recorded so far was at its place. `ended`: the run has ended, with the tip up. `indenter`: what
    presses from now on."""

    press: int
    attempt: int
    step: str
    stamp_ns: int
    reason: str = ''


class Journal:
    """The journal of a plan in a file, which is created if it does not exist.

    Raises:
        ConfigurationError: it belongs to another plan, is damaged before its end, or is in use.
    """

    def __init__(self, path: Path, plan: Plan) -> None:
        self.path = path
        self.repaired = ''
        self._plan = plan
        self._last: dict[int, Entry] = {}
        self._attempts: dict[int, int] = {}
        self._rejects: dict[int, int] = {}
        self._reasons: list[Entry] = []
        self._confirmed: set[tuple[int, int]] = set()
        self._aside: set[int] = set()
        self.patterns = 0
        """How many patterns the runs of this plan have begun."""
        self.indenter = ''
        """What has made the presses; empty: unknown."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise ConfigurationError(f'cannot open the journal {path}: {error.strerror}') from error
        try:
            self._lock()
            self._read()
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice is harmless."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def note(self, press: int, attempt: int, step: str, stamp_ns: int, reason: str = '') -> None:
        """Write an entry; it is on the disk when this returns.

        Raises:
            TactileError: it cannot be written to disk.
        """
        self.note_all([Entry(press, attempt, step, stamp_ns, reason)])

    def note_all(self, entries: Sequence[Entry]) -> None:
        """Write entries, in this order; the disk is waited for once. Raises as `note`."""
        self._write(*(entry.__dict__ for entry in entries))
        for entry in entries:
            self._take(entry)

    def note_run(self, step: str, stamp_ns: int, reason: str = '') -> None:
        """Write a step of the run itself. Raises as `note`."""
        self.note(NO_PRESS, 0, step, stamp_ns, reason)

    def begin_anew(self, stamp_ns: int) -> int:
        """Mark every press to be done again, with new attempt numbers; returns how many were already done."""
        done = self.done
        again = [entry for entry in self._last.values() if entry.step in (*DONE, ASIDE)]
        why = 'the plan was started anew'
        self.note_all([replace(entry, step=MISSING, stamp_ns=stamp_ns, reason=why) for entry in again])
        return done

    def is_done(self, press: int) -> bool:
        """Whether a press needs no further attempt."""
        entry = self._last.get(press)
        return entry is not None and entry.step in DONE

    def next_attempt(self, press: int) -> int:
        """The number of the next attempt at a press: no number is used twice."""
        return self._attempts.get(press, 0) + 1

    def rejects(self, press: int) -> int:
        """How often a press was rejected since the journal was opened; a new start may have removed the cause."""
        return self._rejects.get(press, 0)

    def last(self, press: int) -> Entry | None:
        """The last step of a press."""
        return self._last.get(press)

    def left(self, order: Iterable[Point], most_attempts: int) -> list[Point]:
        """The remaining presses, in this order: not done, not set aside, not rejected as often as allowed."""
        left = (point for point in order if not self.is_done(point.press) and point.press not in self._aside)
        return [point for point in left if self.rejects(point.press) < most_attempts]

    def unverified(self) -> list[Entry]:
        """The last step of each press that was started or recorded, and that no bag has confirmed."""
        return [entry for entry in self._last.values() if entry.step in {STARTED, RECORDED}]

    def unconfirmed(self) -> list[Entry]:
        """The last step of each press that is done and not yet followed by an anchor; the latest is last."""
        done = (entry for entry in self._last.values() if entry.step in DONE)
        return [entry for entry in done if (entry.press, entry.attempt) not in self._confirmed]

    @property
    def done(self) -> int:
        """How many presses need no further attempt."""
        return sum(entry.step in DONE for entry in self._last.values())

    @property
    def aside(self) -> list[int]:
        """The presses at which the force was too large, and which were not made since."""
        return sorted(press for press, entry in self._last.items() if entry.step == ASIDE)

    @property
    def rejected(self) -> list[Entry]:
        """Every rejection so far."""
        return list(self._reasons)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConfigurationError(f'the journal {self.path} is in use by another run of this plan') from error

    def _read(self) -> None:
        data = self._content()
        complete_size = data.rfind(b'\n') + 1
        if complete_size < len(data):
            self.repaired = f'removed an incomplete line of {len(data) - complete_size} bytes at the end of {self.path}'
            os.ftruncate(self._file, complete_size)
        lines = data[:complete_size].splitlines()
        if not lines:
            self._write({'plan': self._plan.plan_id, 'presses': len(self._plan.points), 'version': VERSION})
            return
        self._check_head(self._parsed(lines[0], 1))
        for number, line in enumerate(lines[1:], start=2):
            self._take(self._entry(line, number))
        self._rejects.clear()

    def _content(self) -> bytes:
        try:
            return read_plain(self.path, _LARGEST_BYTES)
        except OSError as error:
            raise ConfigurationError(f'cannot read the journal {self.path}: {error.strerror}') from error

    def _check_head(self, head: Any) -> None:
        if head.get('plan') != self._plan.plan_id:
            raise ConfigurationError(
                f'{self.path} is the journal of plan {head.get("plan")}, but this plan is {self._plan.plan_id}; '
                'choose another folder for another plan'
            )

    def _entry(self, line: bytes, number: int) -> Entry:
        try:
            entry = Entry(**self._parsed(line, number))
            least = NO_PRESS if entry.step in (*OF_THE_RUN, *_OF_THE_MACHINE) else 1
            if entry.step not in STEPS or not least <= entry.press <= len(self._plan.points):
                raise TypeError(entry.step)
        except (TypeError, ValueError) as error:
            raise self._damaged(number) from error
        return entry

    def _parsed(self, line: bytes, number: int) -> Any:
        try:
            found = json.loads(line)
        except ValueError as error:
            raise self._damaged(number) from error
        if not isinstance(found, dict):
            raise self._damaged(number)
        return found

    def _damaged(self, number: int) -> ConfigurationError:
        return ConfigurationError.at(self.path, number, 'this line of the journal is damaged; repair or delete it')

    def _take(self, entry: Entry) -> None:
        if entry.step == ANCHORED:
            self._confirmed.update((each.press, each.attempt) for each in self.unconfirmed())
            return
        if entry.step == PATTERN:
            self.patterns += 1
            return
        if entry.step == INDENTER:
            self.indenter = entry.reason
            return
        if entry.step == ENDED:
            self._aside.clear()  # after the next start by a person, presses that were set aside are tried again
            return
        if entry.step in _OF_THE_MACHINE:
            return
        if entry.step == STARTED:
            self._last.pop(entry.press, None)  # so that it is the latest
        self._last[entry.press] = entry
        self._attempts[entry.press] = max(entry.attempt, self._attempts.get(entry.press, 0))
        if entry.step == ASIDE:
            self._aside.add(entry.press)
        if entry.step == MISSING:
            self._aside.discard(entry.press)
        if entry.step in {REJECTED, ASIDE, BROKEN_OFF}:
            self._reasons.append(entry)
        if entry.step in {REJECTED, ASIDE}:
            self._rejects[entry.press] = self._rejects.get(entry.press, 0) + 1

    def _write(self, *lines: dict[str, Any]) -> None:
        text = b''.join(json.dumps(values).encode('ascii') + b'\n' for values in lines)
        size = os.fstat(self._file).st_size
        try:
            written = 0
            while written < len(text):  # a disk that becomes full accepts a part before it refuses
                written += os.write(self._file, text[written:])
            os.fsync(self._file)
        except OSError as error:
            with contextlib.suppress(OSError):  # if this fails, the next start removes the incomplete line
                os.ftruncate(self._file, size)
            raise TactileError(f'cannot write the journal {self.path}: {error.strerror}; the run ends') from error
