"""What a recorder has to decide and to count, apart from any bus."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from tactile_nodes.bag.writer import BagTotals
from tactile_nodes.clock import NS_PER_S, wall_ns
from tactile_nodes.errors import ConfigurationError

MB = 1_000_000


@dataclass(frozen=True)
class TopicFilter:
    """Which topics to record.

    `names` and whatever `regex` finds itself in, or all of them; where none of the three is given, those that
    `is_default` takes. What `exclude` finds itself in is left out, except for `names`.

    Raises:
        ConfigurationError: an expression that is none.
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
            raise ConfigurationError(f'{str(error.pattern)!r} is no regular expression: {error}') from error

    def takes(self, topic: str) -> bool:
        """Whether to record `topic`, a full name."""
        if topic in self.names:
            return True
        if self.exclude and re.search(self.exclude, topic):
            return False
        if self.everything or (self.regex and re.search(self.regex, topic)):
            return True
        return not (self.names or self.regex) and self.is_default(topic)


class GapCounter:
    """Finds messages that never came in, from the numbers that publishers give to theirs.

    >>> gaps = GapCounter()
    >>> [gaps.note('/force', 'a', number) for number in (7, 8, 11)]
    [0, 0, 2]
    """

    def __init__(self) -> None:
        self._newest: dict[tuple[str, str], int] = {}

    def note(self, topic: str, publisher: str, sequence: int) -> int:
        """How many messages of this publisher are missing between this one and the one before."""
        before = self._newest.get((topic, publisher), sequence - 1)
        self._newest[topic, publisher] = max(before, sequence)
        return max(0, sequence - before - 1)


class Tally:
    """What came in to a recording and what did not, in words.

    `malformed` counts what could not be encoded, `foreign` what came under a topic's name and was of another type or
    version of it, or of a publisher that nobody announced.
    """

    def __init__(self) -> None:
        self.missed = self.malformed = self.foreign = 0
        self._gaps = GapCounter()
        self._bytes_before = 0

    def note(self, topic: str, publisher: str, sequence: int) -> None:
        """A message came in; those that are missing before it are counted."""
        self.missed += self._gaps.note(topic, publisher, sequence)

    @property
    def unfit(self) -> int:
        """Messages that came in and cannot be recorded."""
        return self.malformed + self.foreign

    def rate_mb_s(self, totals: BagTotals, period_s: float) -> float:
        """Payload since the last call, a period ago."""
        rate = (totals.bytes - self._bytes_before) / period_s / MB
        self._bytes_before = totals.bytes
        return rate

    def complaint(self, totals: BagTotals) -> str:
        """What is wrong with the recording; empty when nothing is."""
        if totals.dropped:
            return 'the disk is too slow: messages are dropped'
        if self.foreign:
            return 'foreign messages are left out: of another type, or version of it, or of an unknown publisher'
        return 'messages were lost on their way to the recorder' if self.missed else ''

    def losses(self, totals: BagTotals) -> str:
        """'; 3 lost on the way, 1 malformed', or nothing."""
        lost = {'dropped by the slow disk': totals.dropped, 'lost on the way': self.missed, 'malformed': self.unfit}
        told = ', '.join(f'{count} {why}' for why, count in lost.items() if count)
        return f'; {told}' if told else ''


def describe(totals: BagTotals) -> str:
    """'600 messages (58.3 MB, 3.2 s)'"""
    return f'{totals.messages} messages ({totals.bytes / MB:.1f} MB, {totals.seconds:.1f} s)'


def dated_name() -> Path:
    """The name that ``ros2 bag record`` gives: 'rosbag2_2030_01_31-13_59_59'."""
    return Path(datetime.fromtimestamp(wall_ns() / NS_PER_S).strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))


def folder_of(bag: str) -> Path:
    """The folder to write: as given; a dated one in it where it ends in a slash or is empty."""
    return Path(bag) / dated_name() if bag.endswith('/') or not bag else Path(bag)


def free_folder(folder: Path) -> Path:
    """This folder, or one named after it that does not exist: 'bag', 'bag_2', 'bag_3'."""
    number, found = 1, folder
    while found.exists():
        number += 1
        found = folder.with_name(f'{folder.name}_{number}')
    return found
