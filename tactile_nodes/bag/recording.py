"""Decisions and statistics of a recorder, independent of any bus."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from tactile_nodes.bag.writer import BagTotals
from tactile_nodes.clock import NS_PER_S, wall_ns
from tactile_nodes.errors import ConfigurationError

MB = 1_000_000
LATE_AT_MOST_S = 10.0
"""A topic is heard after some seconds, even on a busy machine. One that is first heard later was silent until then: its
camera was unplugged, or its player paused."""


@dataclass(frozen=True)
class TopicFilter:
    """Selects the topics to record.

    It selects `names` and topics that match `regex`, or all topics. If none of the three is given, it selects those for
    which `is_default` is true. Topics that match `exclude` are left out, except `names`.

    Raises:
        ConfigurationError: an invalid regular expression.
    """

    is_default: Callable[[str], bool]
    names: frozenset[str] = frozenset()
    everything: bool = False
    regex: str = ''
    exclude: str = ''

    def __post_init__(self) -> None:
        try:
            re.compile(self.regex)
            re.compile(self.exclude)
        except re.error as error:
            raise ConfigurationError(f'{str(error.pattern)!r} is not a regular expression: {error}') from error

    def takes(self, topic: str) -> bool:
        """Whether to record `topic`, a full name."""
        if topic in self.names:
            return True
        if self.exclude and re.search(self.exclude, topic):
            return False
        if self.everything or (self.regex and re.search(self.regex, topic)):
            return True
        return not (self.names or self.regex) and self.is_default(topic)


@dataclass
class _Stream:
    """Messages of one publisher: the first and the newest."""

    first: int
    first_ns: int
    newest: int
    newest_ns: int

    def missed_since(self, begin_ns: int) -> tuple[int, float]:
        """Estimated number of messages published from `begin_ns` on before the first received one, by its rate.

        And over how many seconds: a publisher that was started after `begin_ns` was missed only since its start.
        """
        if self.newest <= self.first or self.newest_ns <= self.first_ns:
            return 0, 0.0
        period_ns = (self.newest_ns - self.first_ns) / (self.newest - self.first)
        before_ns = self.first_ns - begin_ns
        late_s = min(before_ns, (self.first - 1) * period_ns) / NS_PER_S
        return (min(self.first - 1, int(before_ns / period_ns)), late_s) if late_s <= LATE_AT_MOST_S else (0, 0.0)


class GapCounter:
    """Finds lost messages, from the sequence numbers of publishers.

    >>> gaps = GapCounter()
    >>> [gaps.note('/force', 'a', number, 0) for number in (7, 8, 11)]
    [0, 0, 2]
    """

    def __init__(self) -> None:
        self._streams: dict[tuple[str, str], _Stream] = {}

    def note(self, topic: str, publisher: str, sequence: int, received_ns: int) -> int:
        """How many messages of this publisher are missing between the previous one and this one."""
        stream = self._streams.get((topic, publisher))
        if stream is None:
            self._streams[topic, publisher] = _Stream(sequence, received_ns, sequence, received_ns)
            return 0
        missing = max(0, sequence - stream.newest - 1)
        if sequence > stream.newest:
            stream.newest, stream.newest_ns = sequence, received_ns
        return missing

    def late(self, begin_ns: int) -> dict[str, tuple[int, float]]:
        """Topics with messages that were missed after `begin_ns`: about how many, and over how many seconds."""
        found: dict[str, tuple[int, float]] = {}
        for (topic, _), stream in self._streams.items():
            count, late_s = stream.missed_since(begin_ns)
            if count > 1:  # one may be the interval before the first
                before, seconds = found.get(topic, (0, 0.0))
                found[topic] = (before + count, max(seconds, late_s))
        return found


class Tally:
    """Received and lost messages of a recording, by topic and as text.

    `malformed` counts messages that could not be encoded. `foreign` counts messages on a topic that had another type,
    or another version of it, or an unannounced publisher. `other_types` names publishers whose messages never come,
    because the bag has their topic with another type. `begin_ns` is the start of the recording. `is_steady` says of a
    topic whether its messages come at a steady pace: only then those before the first that was received can be
    estimated. Of others, such as log messages, there may have been none.
    """

    def __init__(self, begin_ns: int = 0, is_steady: Callable[[str], bool] = lambda _: True) -> None:
        self.missed_of: Counter[str] = Counter()
        self.malformed: Counter[str] = Counter()
        self.foreign: Counter[str] = Counter()
        self.other_types: set[str] = set()
        self.begin_ns = begin_ns
        self._is_steady = is_steady
        self._gaps = GapCounter()
        self._bytes_before = 0

    def note(self, topic: str, publisher: str, sequence: int, received_ns: int) -> None:
        """Count a received message, and the missing ones before it."""
        self.missed_of[topic] += self._gaps.note(topic, publisher, sequence, received_ns)

    @property
    def missed(self) -> int:
        """Messages that were lost on their way to the recorder."""
        return self.missed_of.total()

    @property
    def unfit(self) -> int:
        """Received messages that cannot be recorded."""
        return self.malformed.total() + self.foreign.total()

    def rate_mb_s(self, totals: BagTotals, period_s: float) -> float:
        """Payload rate since the last call, one period ago."""
        rate = (totals.bytes - self._bytes_before) / period_s / MB
        self._bytes_before = totals.bytes
        return rate

    def lost_of(self, dropped_of: Counter[str]) -> Counter[str]:
        """Number of missing messages per topic; `dropped_of` are those that were dropped for a slow disk."""
        late = {topic: count for topic, (count, _) in self._late().items()}
        return +(dropped_of + self.missed_of + self.malformed + self.foreign + Counter(late))

    def complaint(self, totals: BagTotals) -> str:
        """The problem of the recording; empty if there is none."""
        if totals.dropped:
            return 'the disk is too slow: messages are dropped'
        if self.foreign.total():
            return 'foreign messages are left out: of another type, or version of it, or of an unknown publisher'
        if self.other_types:
            return self._of_other_types()
        return f'lost on the way to the recorder: {_listed(self.missed_of)}' if self.missed else ''

    def losses(self, dropped_of: Counter[str], meaning: Callable[[str], str]) -> str:
        """The losses as text, '; lost on the way: 3 of /image_raw. Forces of those …', or an empty text.

        Args:
            dropped_of: the messages of each topic for which the disk was too slow.
            meaning: gives for a topic, as a clause, what a bag with missing messages can still be used for.
        """
        kinds = {
            'dropped by the slow disk': dropped_of,
            'lost on the way': self.missed_of,
            'malformed': self.malformed + self.foreign,
        }
        losses = [f'{why}: {_listed(counts)}' for why, counts in kinds.items() if counts.total()]
        late = [
            f'{topic} {seconds:.1f} s (about {count} messages)'
            for topic, (count, seconds) in sorted(self._late().items())
        ]
        losses += [f'heard late: {", ".join(late)}'] if late else []
        losses += [self._of_other_types()] if self.other_types else []
        return '; ' + '; '.join(losses) + _meanings(self.lost_of(dropped_of), meaning) if losses else ''

    def _late(self) -> dict[str, tuple[int, float]]:
        return {topic: each for topic, each in self._gaps.late(self.begin_ns).items() if self._is_steady(topic)}

    def _of_other_types(self) -> str:
        return f'not recorded, as the bag has the topic with another type: {", ".join(sorted(self.other_types))}'


def _listed(counts: Counter[str]) -> str:
    return ', '.join(f'{count} of {topic}' for topic, count in counts.most_common() if count)


def _meanings(lost: Counter[str], meaning: Callable[[str], str]) -> str:
    topics_of: dict[str, list[str]] = {}
    for topic, _ in lost.most_common():
        topics_of.setdefault(meaning(topic), []).append(topic)
    return ''.join(f'; {", ".join(topics)}: {clause}' for clause, topics in topics_of.items())


def describe(totals: BagTotals) -> str:
    """The totals as text: '600 messages (58.3 MB, 3.2 s)'."""
    return f'{totals.messages} messages ({totals.bytes / MB:.1f} MB, {totals.seconds:.1f} s)'


def dated_name() -> Path:
    """The default name of ``ros2 bag record``: 'rosbag2_2030_01_31-13_59_59'."""
    return Path(datetime.fromtimestamp(wall_ns() / NS_PER_S).strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))


def folder_of(bag: str) -> Path:
    """The folder to write, as a full path: as given; a new dated one in it if it is empty or ends with a slash."""
    folder = Path(bag).absolute()
    return free_folder(folder / dated_name()) if bag.endswith('/') or not bag else folder


def free_folder(folder: Path) -> Path:
    """This folder, or one named after it that does not exist: 'bag', 'bag_2', 'bag_3'."""
    number, found = 1, folder
    while found.exists():
        number += 1
        found = folder.with_name(f'{folder.name}_{number}')
    return found
