"""Compares two recordings of one topic, bit for bit: whether a replay gave the same results as the live run."""

from __future__ import annotations

import dataclasses
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

import numpy as np

from tactile_nodes.bag.content import BagMessage
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.errors import BagError

TIMINGS = frozenset({'stages'})
"""Fields with durations, which a replay does not repeat."""


@dataclass
class Comparison:
    """Messages of two bags with equal stamps. `fields` counts the stamps at which a field differs, by dotted name."""

    common: int = 0
    identical: int = 0
    only_first: int = 0
    only_second: int = 0
    fields: Counter[str] = field(default_factory=Counter)
    texts: Counter[str] = field(default_factory=Counter)
    largest: float = 0.0

    @property
    def same(self) -> bool:
        """Whether there was something to compare, and nothing differed."""
        return 0 < self.common == self.identical

    def lines(self) -> list[str]:
        found = [f'{self.identical} of {self.common} common stamps bit-identical']
        if self.fields:
            named = ', '.join(f'{name} ({count})' for name, count in self.fields.most_common())
            found.append(f'numbers that differ (number of stamps): {named}; largest difference {self.largest:g}')
        if self.texts:
            found.append(f'strings that differ: {", ".join(f"{name} ({n})" for name, n in self.texts.most_common())}')
        if self.only_first or self.only_second:
            found.append(f'stamps only in the first: {self.only_first}, only in the second: {self.only_second}')
        return found


def compare(first: BagReader, second: BagReader, topic: str, ignore: Collection[str] = TIMINGS) -> Comparison:
    """Match the messages of `topic` by the stamp of their headers and compare all their numbers but `ignore`.

    Args:
        first: a bag.
        second: another bag.
        topic: a full name, or the last part of one that each bag has once.
        ignore: fields, by their first name, that may differ.

    Raises:
        BagError: a bag has no such topic, or several; or its messages have no stamps.
        MessageError: bytes that are not a message of their type.
    """
    found = Comparison()
    unmatched: tuple[dict[int, BagMessage], dict[int, BagMessage]] = {}, {}  # few: the bags are read side by side
    for together in zip_longest(_stamped(first, topic), _stamped(second, topic)):
        for side, (stamp_ns, message) in [(side, came) for side, came in enumerate(together) if came]:
            if (other := unmatched[1 - side].pop(stamp_ns, None)) is None:
                unmatched[side][stamp_ns] = message
                continue
            one, two = (other, message) if side else (message, other)
            _compare_one(first.decode(one), second.decode(two), ignore, found)
            found.common += 1
    found.only_first, found.only_second = map(len, unmatched)
    return found


def find_topic(bag: BagReader, topic: str) -> str:
    """The full name of the topic whose full name or last part is `topic`.

    Raises:
        BagError: there is none, or more than one.
    """
    found = [name for name in bag.topics if name == topic or name.endswith(f'/{topic.lstrip("/")}')]
    if topic in found:
        return topic
    if len(found) != 1:
        matches = (
            f'several: {", ".join(found)}; give the full name'
            if found
            else f'none; it has {", ".join(bag.topics) or "no topics"}'
        )
        raise BagError(f'{bag.path}: topics that match {topic!r}: {matches}')
    return found[0]


def _stamped(bag: BagReader, topic: str) -> Iterator[tuple[int, BagMessage]]:
    """The first message of each stamp, and the stamp."""
    name, seen = find_topic(bag, topic), set[int]()
    for message in bag.messages([name]):
        stamp_ns = bag.stamp_ns(message)
        if stamp_ns is not None and stamp_ns not in seen:
            seen.add(stamp_ns)
            yield stamp_ns, message
    if not seen:
        raise BagError(f'{bag.path}: {name} has no message with a stamp, so there is nothing to compare')


def _compare_one(first: Any, second: Any, ignore: Collection[str], found: Comparison) -> None:
    one, other = dict(_values(first, '', ignore)), dict(_values(second, '', ignore))
    differing = [name for name in one.keys() | other.keys() if not _same(one.get(name), other.get(name))]
    texts = [name for name in differing if isinstance(one.get(name, other.get(name)), str)]  # a list may end earlier
    numbers = [name for name in differing if name not in texts]
    found.texts.update(texts)
    found.fields.update(numbers)
    found.identical += not numbers
    for name in numbers:
        found.largest = max(found.largest, _difference(one.get(name), other.get(name)))


def _values(message: Any, prefix: str, ignore: Collection[str]) -> Iterator[tuple[str, Any]]:
    for entry in dataclasses.fields(message):
        if prefix or entry.name not in ignore:
            yield from _leaves(getattr(message, entry.name), f'{prefix}{entry.name}', ignore)


def _leaves(value: Any, name: str, ignore: Collection[str]) -> Iterator[tuple[str, Any]]:
    if dataclasses.is_dataclass(value):
        yield from _values(value, f'{name}.', ignore)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _leaves(item, f'{name}[{number}]', ignore)
    else:
        yield name, value


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and _bits(one) == _bits(other)


def _bits(value: Any) -> bytes:
    """Bytes that distinguish -0.0 from 0.0 and treat equal NaNs as equal."""
    if isinstance(value, np.ndarray):
        return str(value.dtype).encode() + value.tobytes()
    if isinstance(value, float):
        return struct.pack('<d', value)
    return repr(value).encode()


def _difference(one: Any, other: Any) -> float:
    if one is None or other is None or np.shape(one) != np.shape(other):
        return float('inf')
    apart = np.abs(np.asarray(one, np.float64) - np.asarray(other, np.float64))
    return float(np.nanmax(apart)) if np.isfinite(apart).any() else 0.0
