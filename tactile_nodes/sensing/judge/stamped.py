"""Values that hold from a stamp on, so that the value of a frame depends on its stamp, not on the order of arrival."""

from __future__ import annotations

import bisect
from typing import Generic, TypeVar

Value = TypeVar('Value')

KEPT = 100


class ByStamp(Generic[Value]):
    """The value that holds at a stamp: the last one that began at or before it, or else the initial one.

    With 1 from stamp 10 on and 2 from 20 on, stamp 19 has 1, stamp 20 has 2, and stamp 9 the initial value.
    """

    def __init__(self, before: Value) -> None:
        self._from_ns: list[int] = []
        self._values: list[Value] = []
        self._before = before

    def add(self, from_ns: int, value: Value) -> None:
        """Add a value that holds from a stamp on. It replaces earlier values from the same or a later stamp."""
        while self._from_ns and self._from_ns[-1] >= from_ns:  # a recording began again
            self._from_ns.pop()
            self._values.pop()
        self._from_ns.append(from_ns)
        self._values.append(value)
        if len(self._values) > KEPT:
            self._before = self._values[0]
            del self._from_ns[0], self._values[0]

    def at(self, stamp_ns: int) -> Value:
        """The value at a stamp."""
        number = bisect.bisect_right(self._from_ns, stamp_ns)
        return self._values[number - 1] if number else self._before
