"""Completes forces recorded by an earlier release with "unknown" values, so that readers see one version.

Only forces are completed: for other types, a missing field may change results computed from the rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from tactile_nodes.messages import message_class, type_name, types
from tactile_nodes.messages.store import store

COMPLETED = frozenset({type_name(types.ForceDistribution)})
_COVARIANCE = 'wrench_covariance'  # its first number marks it as unknown

Definitions = Mapping[str, Any]
"""Constants and fields of each type by name, as rosbags reads them."""


def is_earlier(name: str, definitions: Definitions) -> bool:
    """Whether a bag's definition of a type only lacks fields that can be marked as unknown.

    A list of messages cannot be marked so: an empty list would mean that there was none.
    """
    if name not in definitions:
        return True
    known, fields = dict(store().fielddefs[name][1]), dict(definitions[name][1])
    if any(known.get(field) != description for field, description in fields.items()):
        return False
    missing = [description for field, description in known.items() if field not in fields]
    nested = [inner for description in fields.values() if (inner := _message_in(description))]
    return not any(_is_list(each) for each in missing) and all(is_earlier(each, definitions) for each in nested)


def completed(message: Any, name: str) -> Any:
    """The message in this release's version of its type; missing fields are NaN, zero or empty."""
    blank = message_class(name)()
    present = {
        field: _completed_field(getattr(message, field), _message_in(description))
        for field, description in store().fielddefs[name][1]
        if hasattr(message, field)
    }
    return _filled_with_unknown(blank, **present)


def _filled_with_unknown(blank: Any, **present: Any) -> Any:
    """A message of zeros turned into one with unknown values, except for `present`."""
    fields = (each.name for each in dataclasses.fields(blank) if each.name not in present)
    return type(blank)(**present, **{field: _unknown(getattr(blank, field), field) for field in fields})


def _completed_field(value: Any, inner: str) -> Any:
    """A field's value, with contained messages completed too."""
    if not inner:
        return value
    return [completed(each, inner) for each in value] if isinstance(value, list) else completed(value, inner)


def _unknown(blank: Any, field: str) -> Any:
    """The "unknown" value of a field, from its value in a message of zeros."""
    if field == _COVARIANCE:
        return np.array([-1.0, *blank[1:]])
    if isinstance(blank, float):
        return math.nan
    if isinstance(blank, np.ndarray) and blank.dtype.kind == 'f':
        return np.full_like(blank, np.nan)
    if dataclasses.is_dataclass(blank):
        return _filled_with_unknown(blank)
    return blank


def _message_in(description: Any) -> str:
    """The type of the messages in a field, one or a list; empty if it holds none."""
    kind, rest = description
    if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        kind, rest = rest[0]
    return str(rest) if kind == Nodetype.NAME else ''


def _is_list(description: Any) -> bool:
    return description[0] == Nodetype.SEQUENCE and bool(_message_in(description))
