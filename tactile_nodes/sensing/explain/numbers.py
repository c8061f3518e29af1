"""Whether the numbers of a readout are numbers: a file may say anything, and a reading would fail on it later."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any


def check_numbers(part: Any) -> None:
    """Look at every field of `part`, and of what it is made of, that is announced as a number or as several.

    Raises:
        TypeError: one is of another kind.
        ValueError: one is not finite where it should be.
    """
    for field in fields(part):
        value = getattr(part, field.name)
        for number, kind in _numbers(value, str(field.type)):
            if isinstance(number, bool) or not isinstance(number, (int, float) if kind == 'float' else int):
                raise TypeError(f'{field.name} cannot be {value!r:.40}')
            if not (math.isfinite(number) or (isinstance(field.default, float) and not math.isfinite(field.default))):
                raise ValueError(f'{field.name} is {number}')
        if is_dataclass(value):
            check_numbers(value)


def _numbers(value: Any, announced: str) -> Iterator[tuple[Any, str]]:
    if announced in {'float', 'int'}:
        yield value, announced
    elif announced.startswith(('tuple[float', 'tuple[int')):
        kind = announced.removeprefix('tuple[').split(',')[0]
        if not isinstance(value, tuple | list) or not value:
            raise TypeError(f'a list of numbers cannot be {value!r:.40}')
        yield from ((each, kind) for each in value)
