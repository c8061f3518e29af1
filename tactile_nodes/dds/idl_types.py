"""Message types for Cyclone DDS, made from the same definitions as our own classes.

Their serializer is never used (it is slow, and refuses arrays): our codec makes the bytes. The types exist so that both
ends agree on the type of a topic.
"""

from functools import cache
from typing import Any

from cyclonedds.idl import annotations, make_idl_struct, types
from rosbags.interfaces import Nodetype

from tactile_nodes.dds.names import dds_type
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import message_class
from tactile_nodes.messages.store import store

_BASES: dict[str, Any] = {
    'bool': bool,
    'byte': types.byte,
    'octet': types.byte,
    'char': types.uint8,  # as in ROS 2 since its first release
    'string': str,
    **{name: getattr(types, name) for name in ('int8', 'int16', 'int32', 'int64', 'float32', 'float64')},
    **{name: getattr(types, name) for name in ('uint8', 'uint16', 'uint32', 'uint64')},
}


@cache
def idl_type(type_name: str) -> type[Any]:
    """The `IdlStruct` of a message type ('geometry_msgs/msg/WrenchStamped').

    Raises:
        MessageError: there is no such type, or it contains wide strings.
    """
    message_class(type_name)
    fields = {name: _field(description) for name, description in store().fielddefs[type_name][1]}
    struct = make_idl_struct(type_name.rpartition('/')[2] + '_', dds_type(type_name).replace('::', '.'), fields)
    final: type[Any] = annotations.final(struct)
    return final


def _field(description: Any) -> Any:
    kind, rest = description
    if kind == Nodetype.NAME:
        return idl_type(rest)
    if kind == Nodetype.BASE:
        base, bound = rest
        if base not in _BASES:
            raise MessageError(f'{base} cannot be sent over DDS here')
        return types.bounded_str[bound] if base == 'string' and bound else _BASES[base]
    inner, count = rest
    element = _field(inner)
    if kind == Nodetype.ARRAY:
        return types.array[element, count]
    return types.sequence[element, count] if count else types.sequence[element]
