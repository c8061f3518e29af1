"""The store of message types: the standard ones of ROS 2, and ours as in ``msg/*.msg``.

The fields of all types are in `definitions.json`, which ``python -m reference.stubs`` writes. To read them from the
classes of rosbags and from our texts would delay the start of every process. Codec and hashes come from rosbags. The
classes are made here, because nodes share messages without copies, so a message must not change. They are frozen, and
every field that is not given is zero, empty or such a message, but for the few defaults of ROS 2 in `_NOT_ZERO`.
"""

from __future__ import annotations

import dataclasses
import json
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Msgdef, Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from tactile_nodes.errors import MessageError
from tactile_nodes.messages.services import SERVICES
from tactile_nodes.paths import PACKAGE, share_directory

_LITTLE = b'\0\1'
_EMPTY = 'structure_needs_at_least_one_member'
_NOT_ZERO = {('geometry_msgs/msg/Quaternion', 'w'): 1.0, ('sensor_msgs/msg/NavSatStatus', 'status'): -2}
# The type to use if two packages share a short name.
_PREFERRED = (PACKAGE, 'builtin_interfaces', 'std_msgs', 'geometry_msgs', 'sensor_msgs', 'diagnostic_msgs')


class MessageStore(Typestore):
    """rosbags' type store with frozen classes."""

    def __init__(self) -> None:
        super().__init__()
        self.fielddefs.update(_definitions())
        self._classes: dict[str, type[Any]] = {}

    def message_class(self, name: str) -> type[Any]:
        """The frozen class of the type `name`.

        Raises:
            MessageError: no such type.
        """
        if name not in self._classes:
            if name not in self.fielddefs:
                raise MessageError(f'there is no message type {name!r}; a type has the form package/msg/Name')
            self._classes[name] = self.types[name] = self._frozen_class(name)
        return self._classes[name]

    def get_msgdef(self, typename: str) -> Msgdef[object]:
        self.message_class(typename)  # before rosbags generates code that makes instances
        return super().get_msgdef(typename)

    def deserialize_cdr_within(self, data: bytes, name: str) -> object:
        """The message at the start of `data`, whatever follows it.

        Raises:
            SerdeError: the bytes are not a message of this type.
        """
        if data[:2] != _LITTLE:
            raise SerdeError('the bytes do not begin like little-endian CDR')
        definition = self.get_msgdef(name)
        try:
            message, _ = definition.deserialize_cdr_le(data[4:], 0, definition.cls, self)
        except (struct.error, UnicodeDecodeError, ValueError) as error:
            raise SerdeError(str(error)) from error
        return message

    def nested(self, name: str) -> Iterator[str]:
        """The message types that the fields of `name` contain, without `name` itself."""
        for _, description in self.fielddefs[name][1]:
            kind, rest = _element(description)
            if kind == Nodetype.NAME:
                yield rest

    def repeated(self, name: str) -> Iterator[str]:
        """The element types, basic or message, of the variable-length sequences in a message, at any depth."""
        for _, description in self.fielddefs[name][1]:
            kind, element = _element(description)
            if description[0] == Nodetype.SEQUENCE:
                yield element if kind == Nodetype.NAME else element[0]
            if kind == Nodetype.NAME:
                yield from self.repeated(element)

    def _frozen_class(self, name: str) -> type[Any]:
        constants, fields = self.fielddefs[name]
        columns = [
            (normalize_fieldname(field), Any, _NOT_ZERO.get((name, field)) or self._default(description))
            for field, description in fields
        ]
        namespace: dict[str, Any] = {constant: value for constant, _, value in constants}
        namespace['__msgtype__'] = name
        namespace['__doc__'] = own_texts().get(name, name)
        class_name = name.rpartition('/')[2]
        columns = columns or [(_EMPTY, Any, dataclasses.field(default=0))]
        # eq=False, because comparing arrays gives no single bool; two messages are equal if their bytes are.
        frozen = dataclasses.make_dataclass(
            class_name, columns, namespace=namespace, frozen=True, kw_only=False, eq=False
        )
        frozen.__module__ = f'{PACKAGE}.messages.types'
        return frozen

    def _default(self, description: Any) -> Any:
        kind, rest = description
        if kind == Nodetype.BASE:
            return dataclasses.field(default=_zero(rest[0]))
        if kind == Nodetype.NAME:
            return dataclasses.field(default_factory=self.message_class(rest))
        (inner_kind, inner), count = rest
        length = count if kind == Nodetype.ARRAY else 0
        if inner_kind == Nodetype.BASE and inner[0] not in {'string', 'wstring'}:
            dtype = np.dtype({'byte': 'u1', 'char': 'u1', 'octet': 'u1'}.get(inner[0], inner[0]))
            return dataclasses.field(default_factory=lambda: np.zeros(length, dtype))
        make = self.message_class(inner) if inner_kind == Nodetype.NAME else str
        return dataclasses.field(default_factory=lambda: [make() for _ in range(length)])


@cache
def store() -> MessageStore:
    return MessageStore()


@cache
def short_names() -> dict[str, str]:
    """The full type name for each class name ('Image')."""
    found: dict[str, str] = {}
    for full in store().fielddefs:
        package, _, short = full.split('/')
        if short not in found or _rank(package) < _rank(found[short].split('/')[0]):
            found[short] = full
    return found


@cache
def own_texts() -> Mapping[str, str]:
    """The definition of each message of this package, and of both messages of each service, by type name.

    Raises:
        ConfigurationError: the package's msg folder is missing.
    """
    folder = share_directory() / 'msg'
    own = {f'{PACKAGE}/msg/{file.stem}': file.read_text(encoding='utf-8') for file in sorted(folder.glob('*.msg'))}
    return {**SERVICES, **own}


@cache
def _definitions() -> Typesdict:
    """Constants and fields of all types, in rosbags' form."""
    text = Path(__file__).with_name('definitions.json').read_text(encoding='utf-8')
    return {
        name: (
            [(constant, base, value) for constant, base, value in constants],
            [(field, _description(kind, rest)) for field, (kind, rest) in fields],
        )
        for name, (constants, fields) in json.loads(text).items()
    }


def _description(kind: int, rest: Any) -> Any:
    """The type of a field: lists of JSON as tuples, and numbers as kinds of nodes."""
    if kind == Nodetype.NAME:
        return Nodetype.NAME, rest
    if kind == Nodetype.BASE:
        return Nodetype.BASE, tuple(rest)
    element, count = rest
    return Nodetype(kind), (_description(*element), count)


def _rank(package: str) -> int:
    return _PREFERRED.index(package) if package in _PREFERRED else len(_PREFERRED)


def _element(description: Any) -> tuple[Nodetype, Any]:
    kind, rest = description
    return (Nodetype(rest[0][0]), rest[0][1]) if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE} else (Nodetype(kind), rest)


def _zero(base: str) -> bool | int | float | str:
    if base in {'string', 'wstring'}:
        return ''
    if base == 'bool':
        return False
    return 0.0 if base.startswith('float') else 0
