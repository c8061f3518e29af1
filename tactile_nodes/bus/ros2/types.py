"""Between rclpy's generated classes and our messages: always by way of the CDR bytes, never field by field.

A numpy number assigned to a field of a generated class ends the process in the C converter, so no field is ever
assigned: topics carry bytes, and a service's request and response are (de)serialised by rclpy as a whole.
"""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from tactile_nodes import messages, paths
from tactile_nodes.errors import BusError, MessageError


def generated_class(type_name: str) -> Any:
    """The class that rosidl generated for 'pkg/msg/Name' or 'pkg/srv/Name'.

    Raises:
        MessageError: we do not know the type either.
        BusError: its package is not in this ROS 2.
    """
    if '/msg/' in type_name:
        messages.message_class(type_name)
    try:
        package, kind, name = type_name.split('/')
        return getattr(importlib.import_module(f'{package}.{kind}'), name)
    except ValueError as error:
        raise MessageError(f'there is no type {type_name!r}; a type has the form package/msg/Name') from error
    except (ImportError, AttributeError) as error:
        hint = (
            'build this package with colcon and source install/setup.bash; a package that pip installed has no '
            'classes for rclpy'
            if package == paths.PACKAGE
            else f'install it (apt: ros-$ROS_DISTRO-{package.replace("_", "-")}) and source its setup.bash'
        )
        raise BusError(f'ROS 2 has no {type_name} here: {hint}') from error


def to_ours(message: Any, type_name: str) -> Any:
    """A message of a generated class as our frozen one.

    Raises:
        MessageError: the bytes do not fit, because the type was another one when ROS 2 was built.
    """
    return messages.decode_within(serialize_message(message), type_name)


def to_theirs(message: Any, type_name: str, generated: Any) -> Any:
    """The reverse.

    Raises:
        MessageError: `message` is of another type, or holds what its type cannot.
    """
    found = getattr(message, '__msgtype__', type(message).__name__)
    if found != type_name:
        raise MessageError(f'expected a {type_name}, not a {found}')
    return deserialize_message(messages.encode(message), generated)
