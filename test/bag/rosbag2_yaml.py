"""What rosbag2 needs of the YAML that describes a bag, after `yaml.hpp` and `qos.cpp` of rosbag2_storage (Jazzy).

They take each field by its name, from the version on that is given here, and throw where one is missing or is of
another kind. yaml-cpp knows scalars as text alone, and so does the loader used here.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

INFINITE = (9223372036, 854775807)  # RMW_DURATION_INFINITE of rmw/time.h
POLICIES = {'history': range(4), 'reliability': range(5), 'durability': range(5), 'liveliness': range(6)}  # rmw/types.h


def load(text: str) -> Any:
    return yaml.load(text, Loader=yaml.BaseLoader)


def decoded(node: Any) -> dict[str, Any]:
    """`YAML::convert<BagMetadata>::decode` of a node; raises what the test shows where that would throw."""
    version = integer(node['version'])
    found = {
        'version': version,
        'storage_identifier': text(node['storage_identifier']),
        'duration': whole(node['duration']['nanoseconds']),
        'starting_time': whole(node['starting_time']['nanoseconds_since_epoch']),
        'message_count': whole(node['message_count']),
        'topics': dict(topic(entry, version) for entry in sequence(node['topics_with_message_count'])),
        'relative_file_paths': [text(entry) for entry in sequence(node['relative_file_paths'])],
    }
    if version >= 3:
        found['compression'] = text(node['compression_format']), text(node['compression_mode'])
    if version >= 5:
        found['files'] = [file_of(entry) for entry in sequence(node['files'])]
    if version >= 6:
        found['custom_data'] = strings(node['custom_data'])
    if version >= 8:
        found['ros_distro'] = text(node['ros_distro'])
    return found


def topic(entry: Any, version: int) -> tuple[str, dict[str, Any]]:
    described = entry['topic_metadata']
    found = {'type': text(described['type']), 'serialization_format': text(described['serialization_format'])}
    if version >= 9:
        found['qos'] = profiles(described['offered_qos_profiles'])
    elif version >= 4:
        found['qos'] = channel_profiles(text(described['offered_qos_profiles']))
    if version >= 7:
        found['type_description_hash'] = text(described['type_description_hash'])
    return text(described['name']), {**found, 'message_count': whole(entry['message_count'])}


def file_of(entry: Any) -> dict[str, Any]:
    return {
        'path': text(entry['path']),
        'starting_time': whole(entry['starting_time']['nanoseconds_since_epoch']),
        'duration': whole(entry['duration']['nanoseconds']),
        'message_count': whole(entry['message_count']),
    }


def channel_profiles(serialized: str) -> list[dict[str, Any]]:
    """`to_rclcpp_qos_vector`, which reads also what stands at an MCAP channel."""
    return profiles(load(serialized)) if serialized else []


def profiles(node: Any) -> list[dict[str, Any]]:
    return [profile(entry) for entry in sequence(node)]


def profile(node: Any) -> dict[str, Any]:
    """Policies as numbers, as up to version 8."""
    found: dict[str, Any] = {name: integer(node[name]) for name in POLICIES}
    assert all(found[name] in values for name, values in POLICIES.items())
    for name in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        found[name] = whole(node[name]['sec']), whole(node[name]['nsec'])
    assert node['avoid_ros_namespace_conventions'] in {'true', 'false'}
    return {**found, 'depth': integer(node['depth'])}


def text(node: Any) -> str:
    assert isinstance(node, str)
    return node


def integer(node: Any) -> int:
    assert re.fullmatch(r'-?\d+', text(node))
    return int(node)


def whole(node: Any) -> int:
    """`as<uint64_t>`."""
    assert 0 <= integer(node) < 2**64
    return int(node)


def sequence(node: Any) -> list[Any]:
    assert isinstance(node, list)
    return node


def strings(node: Any) -> dict[str, str]:
    """A map of strings; an empty one is written as null."""
    assert isinstance(node, dict) or node in {'~', 'null', ''}
    return {text(key): text(value) for key, value in node.items()} if isinstance(node, dict) else {}
