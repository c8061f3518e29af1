"""A message of any type with something in every field, the same each time."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname

from tactile_nodes import messages
from tactile_nodes.messages.store import store

# The one byte of a message without fields, which C needs. No class of rclpy's has it: on the wire it is always 0.
EMPTY = 'structure_needs_at_least_one_member'


def filled(type_name: str, seed: int) -> Any:
    """A message whose strings hold more than ASCII, and whose lengths make every padding of CDR occur."""
    return _message(type_name, random.Random(f'{type_name} {seed}'))


def _message(type_name: str, draw: random.Random) -> Any:
    _, fields = store().fielddefs[type_name]
    values = {normalize_fieldname(field): _value(description, draw) for field, description in fields if field != EMPTY}
    return messages.message_class(type_name)(**values)


def _value(description: Any, draw: random.Random) -> Any:
    kind, rest = description
    if kind == Nodetype.NAME:
        return _message(rest, draw)
    if kind == Nodetype.BASE:
        return _base(rest[0], draw)
    (inner_kind, inner), count = rest
    length = count if kind == Nodetype.ARRAY else min(draw.randrange(6), count or 6)
    items = [_value((inner_kind, inner), draw) for _ in range(length)]
    if inner_kind == Nodetype.BASE and inner[0] not in {'string', 'wstring'}:
        return np.array(items, {'byte': 'u1', 'char': 'u1', 'octet': 'u1'}.get(inner[0], inner[0]))
    return items


def _base(base: str, draw: random.Random) -> Any:
    if base in {'string', 'wstring'}:
        return ''.join(draw.choice('abcµ°é ') for _ in range(draw.randrange(9)))
    if base == 'bool':
        return draw.random() < 0.5
    if base.startswith('float'):
        return float(np.float32(draw.uniform(-1e3, 1e3)))
    bits = {'byte': 8, 'char': 8, 'octet': 8}.get(base) or int(base.removeprefix('u').removeprefix('int'))
    return draw.getrandbits(bits - 1)
