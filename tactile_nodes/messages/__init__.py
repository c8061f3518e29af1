"""Messages, defined once in ``msg/`` (or by ROS 2): their classes, CDR bytes, type hashes and bag schemas."""

from tactile_nodes.messages.codec import (
    decode,
    decode_within,
    definition,
    encode,
    encode_view,
    from_dict,
    message_class,
    repeated,
    stamp_ns,
    time_from_ns,
    to_dict,
    type_hash,
    type_name,
)

__all__ = [
    'decode',
    'decode_within',
    'definition',
    'encode',
    'encode_view',
    'from_dict',
    'message_class',
    'repeated',
    'stamp_ns',
    'time_from_ns',
    'to_dict',
    'type_hash',
    'type_name',
]
