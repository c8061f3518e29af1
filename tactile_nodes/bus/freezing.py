"""Makes the arrays of a message read-only, because the nodes of a process share them."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np


def freeze_arrays(message: Any) -> None:
    """Make all arrays in `message` read-only, including those of nested messages."""
    kind: Any = type(message)
    for name in _may_hold_arrays(kind):
        _freeze(getattr(message, name))


def _freeze(value: Any) -> None:
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, list):
        for item in value:
            freeze_arrays(item)
    else:
        freeze_arrays(value)


@cache
def _may_hold_arrays(kind: Any) -> tuple[str, ...]:
    """The fields of a message class that are arrays, or messages with arrays; found from an empty instance."""
    if not hasattr(kind, '__dataclass_fields__'):
        return ()
    empty = kind()
    return tuple(field.name for field in dataclasses.fields(kind) if _can_hold(getattr(empty, field.name)))


def _can_hold(value: Any) -> bool:
    # A list is empty here, so the type of its elements is not known.
    kind: Any = type(value)
    return isinstance(value, (np.ndarray, list)) or bool(_may_hold_arrays(kind))
