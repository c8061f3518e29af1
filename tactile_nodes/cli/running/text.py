"""Messages as text, as ``ros2`` prints them: YAML, one line of CSV, or a Python expression."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from rosbags.interfaces import Nodetype

from tactile_nodes import messages
from tactile_nodes.errors import MessageError
from tactile_nodes.messages.store import store

TRUNCATE_LENGTH = 128
_EMPTY = 'structure_needs_at_least_one_member'
_WIDTH = 2**31 - 1  # never break a line; the largest value of the emitter's C code
_STEP = re.compile(r'(\w+)((?:\[\d+\])*)')


@dataclass(frozen=True)
class Shown:
    """How much of a message is shown: elements of an array or characters of a string; None for all."""

    length: int | None = TRUNCATE_LENGTH
    arrays: bool = True
    strings: bool = True


def to_yaml(value: Any, shown: Shown, flow_style: bool = False) -> str:
    """A message, or the value of one of its fields, as YAML, with a line break at its end."""
    dumped: str = yaml.dump(
        plain(value, shown),
        Dumper=_Dumper,
        allow_unicode=True,
        default_flow_style=flow_style,
        sort_keys=False,
        width=_WIDTH,
    )
    return dumped.removesuffix('...\n')  # the end of a YAML document that is a single number


def to_csv(value: Any, shown: Shown) -> str:
    """All values of a message, those of nested ones included, separated by commas."""
    return ','.join(_leaves(plain(value, shown)))


def to_python(value: Any) -> str:
    """A message as ros2 shows published messages and responses: ``std_msgs.msg.String(data='hello')``."""
    if dataclasses.is_dataclass(value):
        name = messages.type_name(value).replace('/', '.')
        return f'{name}({", ".join(f"{field}={to_python(item)}" for field, item in _fields(value))})'
    if isinstance(value, (list, np.ndarray)):
        return f'[{", ".join(map(to_python, value))}]'
    return repr(value.item() if isinstance(value, np.generic) else value)


def field_of(message: Any, path: str) -> Any:
    """The value of a field; `path` names it, as in ``header.stamp`` or ``normal_force[40]``.

    Raises:
        MessageError: there is no such field.
    """
    value = message
    for step in filter(None, path.split('.')):
        match = _STEP.fullmatch(step)
        try:
            value = getattr(value, match[1] if match else step)
            for index in re.findall(r'\d+', match[2] if match else ''):
                value = value[int(index)]
        except (AttributeError, IndexError, TypeError) as error:
            raise MessageError(f'{messages.type_name(message)} has no {path!r}: {_choices(value)}') from error
    return value


def plain(value: Any, shown: Shown) -> Any:
    """A message as dicts, lists, numbers and strings, shortened as `shown` says."""
    if dataclasses.is_dataclass(value):
        described = dict(store().fielddefs[messages.type_name(value)][1])
        return {name: _shortened(item, described.get(name), shown) for name, item in _fields(value)}
    return _shortened(value, None, shown)


def _shortened(value: Any, description: Any, shown: Shown) -> Any:
    if isinstance(value, str):
        return _short_text(value, shown)
    if isinstance(value, (list, np.ndarray)):
        if not shown.arrays:
            return _kind_of(value, description)
        cut = len(value) if shown.length is None else shown.length
        items = value[:cut].tolist() if isinstance(value, np.ndarray) else [plain(item, shown) for item in value[:cut]]
        return [*items, '...'] if len(value) > cut else items
    if isinstance(value, np.generic):
        return value.item()
    return plain(value, shown) if dataclasses.is_dataclass(value) else value


def _short_text(value: str, shown: Shown) -> str:
    if not shown.strings:
        return f'<string length: <{len(value)}>>'
    return value if shown.length is None or len(value) <= shown.length else f'{value[: shown.length]}...'


def _kind_of(value: Any, description: Any) -> str:
    """The type of an array, printed instead of its elements."""
    if description is None:
        return f'<sequence length: {len(value)}>'
    kind, ((_, inner), _length) = description
    name = inner if isinstance(inner, str) else inner[0]
    whole = kind == Nodetype.ARRAY
    return f'<array type: {name}[{len(value)}]>' if whole else f'<sequence type: {name}, length: {len(value)}>'


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    for field in dataclasses.fields(message):
        if field.name != _EMPTY:
            yield field.name, getattr(message, field.name)


def _leaves(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _leaves(item)
    else:
        yield str(value)


def _choices(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        return f'its fields are {", ".join(name for name, _ in _fields(value))}'
    return f'it holds {len(value)} elements' if isinstance(value, (list, np.ndarray)) else 'it has no fields'


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Indents lists as PyYAML does, and writes no anchors for equal parts."""

    def ignore_aliases(self, _: Any) -> bool:
        return True
