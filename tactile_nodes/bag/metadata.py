"""``metadata.yaml`` of a rosbag2 folder, and the text for a topic's quality of service in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import yaml

from tactile_nodes.errors import BagError
from tactile_nodes.messages import definition, type_hash

VERSION = 8  # the newest that ROS 2 Humble can read: from 9 on, the quality of service is a list instead of a string
NEWEST = 9
FILE_NAME = 'metadata.yaml'
MOST_FILES = 1000  # of a bag: a reader keeps each open
LARGEST_METADATA_BYTES = 1 << 20  # enough for so many files and topics
_ROOT = 'rosbag2_bagfile_information'
# Those of libyaml take a fifth of the time, or less; a recorder writes its description once a second.
_Loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_SafeDumper: Any = yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper


@dataclass(frozen=True)
class BagTopic:
    """A topic as described in a bag. `definition` is empty if the bag has none."""

    name: str
    type_name: str
    definition: str = ''
    type_hash: str = ''
    qos: str = ''
    encoding: str = 'cdr'
    definition_format: str = 'ros2msg'

    @classmethod
    def of_type(cls, name: str, type_name: str, *, depth: int = 10, latched: bool = False) -> BagTopic:
        """A topic of a type that `messages` knows.

        Raises:
            MessageError: the type is unknown.
        """
        return cls(name, type_name, definition(type_name), type_hash(type_name), qos_text(depth, latched))

    @property
    def latched(self) -> bool:
        """Whether its publisher kept the last message for late subscribers (transient local)."""
        try:
            profiles = _load(self.qos) or []
            return any(str(profile['durability']).lower() in {'1', 'transient_local'} for profile in profiles)
        except (yaml.YAMLError, TypeError, KeyError, ValueError, RecursionError):
            return False


def qos_text(depth: int, latched: bool) -> str:
    """The offered quality of service in the format of Humble to Jazzy: reliable, keep last `depth`."""
    for_ever = {'sec': 9223372036, 'nsec': 854775807}
    profile = {
        'history': 1,
        'depth': depth,
        'reliability': 1,
        'durability': 1 if latched else 2,
        'deadline': dict(for_ever),  # separate objects: else the dumper writes aliases
        'lifespan': dict(for_ever),
        'liveliness': 1,
        'liveliness_lease_duration': dict(for_ever),
        'avoid_ros_namespace_conventions': False,
    }
    return yaml.safe_dump([profile], sort_keys=False).rstrip()


@dataclass
class Extent:
    """Number of messages, and their first and last receive time in ns; both times are 0 without messages."""

    messages: int = 0
    start_ns: int = 0
    end_ns: int = 0

    def include(self, log_ns: int) -> None:
        """Count one more message."""
        self.start_ns = min(self.start_ns, log_ns) if self.messages else log_ns
        self.end_ns = max(self.end_ns, log_ns) if self.messages else log_ns
        self.messages += 1

    @classmethod
    def union(cls, parts: Iterable[Extent]) -> Extent:
        filled = [part for part in parts if part.messages]
        if not filled:
            return cls()
        count = sum(part.messages for part in filled)
        return cls(count, min(part.start_ns for part in filled), max(part.end_ns for part in filled))

    @property
    def duration_ns(self) -> int:
        return self.end_ns - self.start_ns


@dataclass
class BagMetadata:
    """The content of ``metadata.yaml``."""

    files: dict[str, Extent] = field(default_factory=dict)
    topics: dict[str, BagTopic] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    message_count: int = 0
    storage_id: str = 'mcap'
    ros_distro: str = ''
    compression_format: str = ''
    compression_mode: str = ''

    def to_yaml(self) -> str:
        return _dump({_ROOT: self._content()})

    def to_record(self) -> str:
        """The text in an MCAP file, which rosbag2's storage reads without the top-level key of the file."""
        return _dump(self._content())

    def _content(self) -> dict[str, Any]:
        extent = Extent.union(self.files.values())
        return {
            'version': VERSION,
            'storage_identifier': self.storage_id,
            **_times(extent),
            'message_count': extent.messages,
            'topics_with_message_count': [self._topic(topic) for topic in self.topics.values()],
            'compression_format': _Quoted(self.compression_format),
            'compression_mode': _Quoted(self.compression_mode),
            'relative_file_paths': list(self.files),
            'files': [
                {'path': path, **_times(part), 'message_count': part.messages} for path, part in self.files.items()
            ],
            'custom_data': None,
            'ros_distro': _Quoted(self.ros_distro),
        }

    def _topic(self, topic: BagTopic) -> dict[str, Any]:
        described = {
            'name': topic.name,
            'type': topic.type_name,
            'serialization_format': topic.encoding,
            'offered_qos_profiles': _Quoted(topic.qos),
            'type_description_hash': topic.type_hash,
        }
        return {'topic_metadata': described, 'message_count': self.counts.get(topic.name, 0)}

    @classmethod
    def from_yaml(cls, text: str, source: str) -> BagMetadata:
        """Read the format of any version up to 9.

        Raises:
            BagError: it is damaged, or newer than supported.
        """
        try:
            content = _load(text)[_ROOT]
            version = int(content['version'])
            if version > NEWEST:
                raise BagError(f'{source} has version {version}; versions up to {NEWEST} can be read')
            return cls._from_content(content)
        except (yaml.YAMLError, TypeError, KeyError, ValueError, AttributeError, RecursionError) as error:
            raise BagError(
                f'{source} is damaged and does not describe the bag; use the .mcap or .db3 file beside it instead'
            ) from error

    @classmethod
    def _from_content(cls, content: dict[str, Any]) -> BagMetadata:
        entries = content['topics_with_message_count'] or []
        topics = [_read_topic(entry['topic_metadata']) for entry in entries]
        return cls(
            # Older versions stored paths relative to the recorder's folder; the files are beside metadata.yaml.
            files={PurePath(str(path)).name: Extent() for path in content['relative_file_paths']},
            topics={topic.name: topic for topic in topics},
            counts={str(entry['topic_metadata']['name']): int(entry['message_count']) for entry in entries},
            message_count=int(content['message_count']),
            storage_id=str(content['storage_identifier']),
            ros_distro=str(content.get('ros_distro') or ''),
            compression_format=str(content.get('compression_format') or ''),
            compression_mode=str(content.get('compression_mode') or '').lower(),
        )


def _read_topic(described: dict[str, Any]) -> BagTopic:
    qos = described.get('offered_qos_profiles') or ''
    return BagTopic(
        str(described['name']),
        str(described['type']),
        type_hash=str(described.get('type_description_hash') or ''),
        qos=qos if isinstance(qos, str) else yaml.safe_dump(qos),
        encoding=str(described.get('serialization_format') or 'cdr'),
    )


def _times(extent: Extent) -> dict[str, dict[str, int]]:
    return {
        'duration': {'nanoseconds': extent.duration_ns},
        'starting_time': {'nanoseconds_since_epoch': extent.start_ns},
    }


def _load(text: str) -> Any:
    """The parsed text. Aliases are refused: recorders write none, and a few lines of them can expand to gigabytes."""
    if '*' in text and any(isinstance(each, yaml.AliasEvent) for each in yaml.parse(text, Loader=_Loader)):
        raise yaml.YAMLError('an alias')
    return yaml.load(text, Loader=_Loader)  # noqa: S506 - a safe one


class _Quoted(str):
    """A string in double quotes, on one line, as ROS 2 writes it."""

    __slots__ = ()


class _Dumper(_SafeDumper):  # type: ignore[misc]
    """Supports `_Quoted`."""


_Dumper.add_representer(
    _Quoted, lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', str(text), style='"')
)


def _dump(content: dict[str, Any]) -> str:
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=10_000)
