"""The message types of a bag as the bag defines them: they may be unknown here, or older versions of ours."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from rosbags.typesys import TypesysError, get_types_from_msg

from tactile_nodes import messages
from tactile_nodes.bag.metadata import BagTopic
from tactile_nodes.bag.older import COMPLETED, completed, is_earlier
from tactile_nodes.bag.stamps import is_headed, starts_with_header
from tactile_nodes.errors import MessageError
from tactile_nodes.messages.store import MessageStore, store

_TYPE_NAME = re.compile(r'[a-z][a-z0-9_]*(/[a-z]+)?/[A-Za-z][A-Za-z0-9_]*', re.ASCII)
_FIELD_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*', re.ASCII)


class BagTypes:
    """Decodes with the definitions in a bag; falls back to ours if it has none.

    Definitions stay in this object: two bags may have two versions of a type. Forces of earlier releases are completed.
    """

    def __init__(self) -> None:
        self._local: MessageStore | None = None
        self._foreign: set[str] = set()
        self._earlier: set[str] = set()

    def learn(self, topic: BagTopic) -> None:
        """Add a topic's type. A definition that cannot be read is skipped."""
        if topic.definition_format != 'ros2msg' or not topic.definition or not _TYPE_NAME.fullmatch(topic.type_name):
            return
        try:
            parsed = _parsed(topic.definition, topic.type_name)
        except (TypesysError, RecursionError):
            return
        if all(_is_plain(name, content) for name, content in parsed.items()) and _differs(parsed):
            self._local = self._local or MessageStore()
            # Not `register`, which would run code made from names in an untrusted file.
            self._local.fielddefs.update(parsed)
            self._foreign.add(topic.type_name)
            if topic.type_name in COMPLETED and is_earlier(topic.type_name, parsed):
                self._earlier.add(topic.type_name)

    def is_ours(self, type_name: str) -> bool:
        """Whether the bag's version of this type is the same as ours."""
        return type_name not in self._foreign and type_name in store().fielddefs

    def starts_with_header(self, type_name: str) -> bool:
        """Whether the first field of the bag's version of a type is a std_msgs/Header."""
        if self._local is None or type_name not in self._foreign:
            return starts_with_header(type_name)
        return is_headed(self._local.fielddefs[type_name][1])

    def is_completed(self, type_name: str) -> bool:
        """Whether it is the version of an earlier release, which `decode` completes."""
        return type_name in self._earlier

    def decode(self, data: bytes, type_name: str) -> Any:
        """The message in `data`.

        Raises:
            MessageError: a type that is not defined here or in the bag, or invalid bytes.
        """
        if self._local is None or type_name not in self._foreign:
            return messages.decode(data, type_name)
        try:
            found = self._local.deserialize_cdr(data, type_name)
        except Exception as error:  # an untrusted definition can fail in any way
            raise MessageError(f'{len(data)} bytes are not a {type_name} as defined in this bag: {error}') from error
        return completed(found, type_name) if type_name in self._earlier else found


@lru_cache(maxsize=64)  # it takes milliseconds, and the bags of a session have the same types
def _parsed(definition: str, type_name: str) -> Mapping[str, Any]:
    return get_types_from_msg(definition, type_name)


def _is_plain(name: str, content: Any) -> bool:
    constants, fields = content
    names = [entry[0] for entry in (*constants, *fields)]
    return bool(_TYPE_NAME.fullmatch(name)) and all(_FIELD_NAME.fullmatch(entry) for entry in names)


def _differs(parsed: Any) -> bool:
    known = store().fielddefs
    return any(name not in known or known[name][1] != fields for name, (_, fields) in parsed.items())
