"""What a recorder has to decide and to count, apart from any bus."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from tactile_nodes.errors import ConfigurationError


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
