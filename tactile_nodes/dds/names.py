"""ROS 2's names on DDS.

Sources: the design article "Topic and Service name mapping to DDS" (design.ros2.org) for topics and types; REP-2016 and
rmw's ``typehash=…;`` for the hash; rmw_dds_common for the topic of discovery and for ``enclave=…;``.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.messages import type_hash

DISCOVERY = 'ros_discovery_info'
"""The DDS topic on which each participant announces its nodes, with their readers and writers."""
PARTICIPANT_DATA = b'enclave=/;'
"""USER_DATA of a participant."""


@dataclass(frozen=True)
class NodeEnds:
    """A node's writers and readers, by their gids: the 16 bytes of their GUIDs."""

    writers: tuple[bytes, ...] = ()
    readers: tuple[bytes, ...] = ()


def dds_topic(topic: str) -> str:
    """The DDS topic of a full topic name.

    >>> dds_topic('/skin/wrench')
    'rt/skin/wrench'
    """
    return f'rt{topic}'


def dds_type(type_name: str) -> str:
    """The DDS type of a message type.

    >>> dds_type('geometry_msgs/msg/WrenchStamped')
    'geometry_msgs::msg::dds_::WrenchStamped_'
    """
    package, kind, name = type_name.split('/')
    return f'{package}::{kind}::dds_::{name}_'


def endpoint_data(type_name: str) -> bytes:
    """USER_DATA of a reader or writer: its type hash, without which ROS 2 warns.

    Raises:
        MessageError: no such type.
    """
    return f'typehash={type_hash(type_name)};'.encode()


def split_name(node: str) -> tuple[str, str]:
    """Namespace and name of a node.

    >>> split_name('/skin/left/camera')
    ('/skin/left', 'camera')
    >>> split_name('/camera')
    ('/', 'camera')
    """
    namespace, _, name = node.rpartition('/')
    return namespace or '/', name
