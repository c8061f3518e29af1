"""Encodes and decodes messages: CDR (XCDR1, little endian), as rclpy writes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys.base import normalize_fieldname

from tactile_nodes.errors import MessageError
from tactile_nodes.messages.store import own_texts, store

NS_PER_S = 1_000_000_000


def encode(message: Any) -> bytes:
    """The CDR bytes of a message, including the four-byte header.

    Raises:
        MessageError: a field has a value that its type cannot hold.
    """
    return bytes(encode_view(message))


def encode_view(message: Any) -> memoryview:
    """Like `encode`, as a view of the encoder's buffer, which saves a copy. Raises the same errors."""
    name = type_name(message)
    try:
        return store().serialize_cdr(message, name)
    except UnicodeEncodeError:  # the name of a folder that is not UTF-8: such letters are sent as their codes
        return encode_view(_escaped(message))
    except Exception as error:  # generated code raises many kinds of errors for a wrong field
        raise MessageError(f'a field of this {name} has an invalid value: {error}') from error


def decode(data: bytes | memoryview, name: str) -> Any:
    """The message of type `name` in `data`; its arrays are read-only views of `data`.

    Raises:
        MessageError: no such type, or the bytes are not a message of this type.
    """
    return _decoded(data, name, store().deserialize_cdr)


def decode_within(data: bytes, name: str) -> Any:
    """The message of type `name` at the start of `data`; like `decode`, but ignores bytes after the message.

    Fast DDS serializes for rclpy into a buffer of estimated length, and the bytes after the message are not initialized
    (rmw_fastrtps_cpp, rmw_serialize.cpp).

    Raises:
        MessageError: no such type, or the bytes are not a message of this type.
    """
    return _decoded(data, name, store().deserialize_cdr_within)


def _escaped(value: Any) -> Any:
    r"""A message or a part of it, whose texts can be encoded: 'm\udcfc' becomes r'm\udcfc'."""
    if isinstance(value, str):
        return value.encode(errors='backslashreplace').decode()
    if isinstance(value, list):
        return [_escaped(each) for each in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.replace(value, **{each: _escaped(part) for each, part in vars(value).items()})
    return value


def _decoded(data: Any, name: str, decoder: Callable[[Any, str], Any]) -> Any:
    message_class(name)
    try:
        return decoder(data, name)
    except (SerdeError, IndexError, AssertionError, OverflowError, MemoryError, RecursionError) as error:
        raise MessageError(f'{len(data)} bytes are not a {name}: {error}') from error


def message_class(name: str) -> type[Any]:
    """The frozen class of the type `name` ('sensor_msgs/msg/Image').

    Raises:
        MessageError: no such type.
    """
    return store().message_class(name)


def type_name(message: Any) -> str:
    """The type name of a message or of a message class, 'sensor_msgs/msg/Image'."""
    name: str = message.__msgtype__
    return name


def type_hash(name: str) -> str:
    """The type's RIHS01 hash (REP-2016), as ROS 2 computes it: 'RIHS01_<64 hex>'.

    Raises:
        MessageError: no such type.
    """
    message_class(name)
    return store().hash_rihs01(name)


def definition(name: str) -> str:
    """The full definition of a type: its text and, after separators, the texts of the types that it contains.

    Our own types are given as in ``msg/``, with comments. For the standard types only the fields are given, because no
    dependency contains their texts.

    Raises:
        MessageError: no such type.
    """
    message_class(name)
    message_store = store()
    found = [name]
    for entry in found:
        found += [nested for nested in message_store.nested(entry) if nested not in found]
    parts = [_text(name)] + [f'{"=" * 80}\nMSG: {_short(entry)}\n{_text(entry)}' for entry in found[1:]]
    return '\n'.join(parts)


def repeated(name: str) -> frozenset[str]:
    """The element types of a message's variable-length sequences, such as 'float32' and 'geometry_msgs/msg/Point'.

    Raises:
        MessageError: no such type.
    """
    message_class(name)
    return frozenset(store().repeated(name))


def stamp_ns(time: Any) -> int:
    """A builtin_interfaces/Time as integer nanoseconds."""
    return int(time.sec) * NS_PER_S + int(time.nanosec)


def time_from_ns(nanoseconds: int) -> Any:
    """Integer nanoseconds as a builtin_interfaces/Time.

    >>> time_from_ns(1_500_000_000)
    Time(sec=1, nanosec=500000000)
    """
    sec, nanosec = divmod(nanoseconds, NS_PER_S)
    return _time_class()(sec, nanosec)


@cache
def _time_class() -> type[Any]:
    return message_class('builtin_interfaces/msg/Time')


def to_dict(message: Any) -> dict[str, Any]:
    """A message as plain Python (dicts, lists, numbers, strings), in field order, for printing."""
    return {field.name: _plain(getattr(message, field.name)) for field in dataclasses.fields(message)}


def from_dict(name: str, values: Mapping[str, Any]) -> Any:
    """The message of type `name` with these fields set, the others by default, like the argument of ``ros2 topic pub``.

    Raises:
        MessageError: no such type or field, or a value that does not fit.
    """
    message_type = message_class(name)
    fields = {normalize_fieldname(field): description for field, description in store().fielddefs[name][1]}
    if unknown := sorted(values.keys() - fields.keys()):
        raise MessageError(f'{name} has no field {unknown[0]!r}; it has: {", ".join(fields) or "none"}')
    message = message_type(**{key: _typed(fields[key], value, f'{name}.{key}') for key, value in values.items()})
    encode(message)  # finds a value that does not fit here, not at a subscriber
    return message


def _text(name: str) -> str:
    own = own_texts()
    return own[name] if name in own else store().gendefhash(name, {}, 2)[0]


def _short(name: str) -> str:
    package, _, stem = name.split('/')
    return f'{package}/{stem}'


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _typed(description: Any, value: Any, place: str) -> Any:
    kind, rest = description
    try:
        if kind == Nodetype.NAME:
            return from_dict(rest, value)
        if kind == Nodetype.BASE:
            return _base(rest[0], value)
        (inner_kind, inner), _ = rest
        if not isinstance(value, (list, tuple, np.ndarray)):  # else a text would become a list of its letters
            raise TypeError('expected a list')
        if inner_kind == Nodetype.BASE and inner[0] not in {'string', 'wstring'}:
            return np.array(value, {'byte': 'u1', 'char': 'u1', 'octet': 'u1'}.get(inner[0], inner[0]))
        return [_typed((inner_kind, inner), item, place) for item in value]
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MessageError(f'{place} cannot be {value!r}: {error}') from error


def _base(base: str, value: Any) -> Any:
    if base in {'string', 'wstring'}:
        return str(value)
    if base == 'bool':
        if not isinstance(value, bool):
            raise TypeError('expected true or false')
        return value
    return float(value) if base.startswith('float') else int(value)
