"""A launch file as YAML: items that know their line, and maps whose keys are read and type-checked one by one.

ROS 2's YAML frontend converts no types: ``respawn: true`` is an error because the key takes a string. This module is
equally strict, so that a file accepted here does not fail on a robot. It also refuses duplicate keys.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml

from tactile_nodes.errors import LaunchFileError
from tactile_nodes.files import read_text
from tactile_nodes.launching.template import Place, Template, parse_template, unescape

Read = TypeVar('Read')

SUFFIXES = ('.launch.yaml', '.launch.yml', '.yaml', '.yml', '.launch')
_MAX_DEPTH = 60
_MAX_ITEMS = 100_000
_SCALARS = {f'tag:yaml.org,2002:{kind}' for kind in ('str', 'int', 'float', 'bool', 'null', 'timestamp')}
_NAMES = {str: 'str', bool: 'bool', int: 'int', float: 'float', list: 'a list', dict: 'a map', type(None): 'nothing'}
_HINTS = {
    str: 'put it in quotes, since ROS 2 does not convert it',
    float: 'write it with a decimal point, like 1.0',
}


@dataclass(frozen=True)
class Item:
    """A value of a launch file and its location; `value` is a scalar, a list of items or a dict of items by key."""

    value: Any
    place: Place


class Entity:
    """A map of a launch file that belongs to an action, or to a part of one (an ``env``, a ``param``).

    Each key is read once with its type; `finish` then refuses keys that were not read.
    """

    def __init__(self, kind: str, item: Item) -> None:
        self.kind = kind
        self.place = item.place
        if not isinstance(item.value, dict):
            raise item.place.error(f'{kind}: expected a map, got {type_name(item.value)}')
        self._items: dict[str, Item] = item.value
        self._read: list[str] = []

    def text(self, key: str) -> str:
        """A string without substitutions; only ``\\`` escapes are processed."""
        return unescape(self._typed(key, str).value)

    def text_or_none(self, key: str) -> str | None:
        return self._optional(key, self.text)

    def template(self, key: str) -> Template:
        """A string with substitutions, parsed."""
        item = self._typed(key, str)
        return parse_template(item.value, item.place)

    def template_or_none(self, key: str) -> Template | None:
        return self._optional(key, self.template)

    def boolean(self, key: str, default: bool) -> bool:
        return bool(self._typed(key, bool).value) if self._has(key) else default

    def number_or_none(self, key: str) -> float | None:
        return self._optional(key, self._finite)

    def integer(self, key: str, default: int) -> int:
        return int(self._typed(key, int).value) if self._has(key) else default

    def template_or(self, key: str, kind: type, default: Any) -> Any:
        """A `kind`, or a string whose substitutions give one; `default` if the key is absent."""
        item = self._optional(key, self.item)
        if item is None:
            return default
        if isinstance(item.value, str):
            return parse_template(item.value, item.place)
        return self._check(key, item, kind).value

    def item(self, key: str) -> Item:
        """The value of a key, of any type."""
        self._expect(key)
        if key not in self._items:
            raise self.place.error(f"{self.kind}: the key '{key}' is missing")
        return self._items[key]

    def item_or_none(self, key: str) -> Item | None:
        return self._optional(key, self.item)

    def entities(self, key: str) -> list[Entity]:
        """A list of maps; empty if the key is absent."""
        item = self.item_or_none(key)
        if item is None:
            return []
        if not isinstance(item.value, list) or not item.value:
            raise item.place.error(f"{self.kind}: '{key}' takes a list of maps, got {type_name(item.value)}")
        return [Entity(key, each) for each in item.value]

    def entities_of(self, key: str, read: Callable[[Entity], Read]) -> tuple[Read, ...]:
        """`entities`, each read by a function and then checked for unread keys."""
        return tuple(_finished(entity, read) for entity in self.entities(key))

    def finish(self) -> None:
        """Refuse keys that were not read."""
        for key, item in self._items.items():
            if key not in self._read:
                raise item.place.error(f"{self.kind}: unknown key '{key}'{suggestion(key, self._read)}")

    def _typed(self, key: str, kind: type) -> Item:
        return self._check(key, self.item(key), kind)

    def _check(self, key: str, item: Item, kind: type) -> Item:
        if type(item.value) is not kind:
            hint = f'; {_HINTS[kind]}' if kind in _HINTS and not isinstance(item.value, (list, dict)) else ''
            raise item.place.error(f"{self.kind}: '{key}' expected {_NAMES[kind]}, got {type_name(item.value)}{hint}")
        return item

    def _finite(self, key: str) -> float:
        item = self._typed(key, float)
        if not math.isfinite(item.value):
            raise item.place.error(f"{self.kind}: '{key}' must be finite, got {item.value}")
        return float(item.value)

    def _optional(self, key: str, read: Callable[[str], Read]) -> Read | None:
        return read(key) if self._has(key) else None

    def _has(self, key: str) -> bool:
        self._expect(key)
        return key in self._items

    def _expect(self, key: str) -> None:
        if key not in self._read:
            self._read.append(key)


def load_items(file: Path) -> list[tuple[str, Item]]:
    """The actions of a launch file, in order, each as (name, content).

    Raises:
        LaunchFileError: no such file, not valid YAML, or not of the form ``launch: [{action: …}, …]``.
    """
    place = Place(file, 1)
    root = _load(file)
    if root is None or not isinstance(root.value, dict):
        raise place.error("a launch file has one root key, 'launch'")
    if list(root.value) != ['launch']:
        raise root.place.error(f"a launch file has one root key, 'launch'; found: {', '.join(root.value)}")
    return actions_of('launch', root.value['launch'])


def actions_of(kind: str, item: Item) -> list[tuple[str, Item]]:
    """The actions in a list of one-key maps, each as (name, content)."""
    if not isinstance(item.value, list):
        raise item.place.error(f'{kind}: expected a list of actions, got {type_name(item.value)}')
    return [_action(each) for each in item.value]


def type_name(value: object) -> str:
    """A type, in terms that the author of a launch file knows."""
    return _NAMES.get(type(value), type(value).__name__)


def suggestion(word: str, candidates: Iterable[str]) -> str:
    """``; did you mean 'x'?`` if a known word is close, else ``; known: …``."""
    candidates = sorted(candidates)
    close = difflib.get_close_matches(word, candidates, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f'; known: {", ".join(candidates)}' if candidates else ''


def _finished(entity: Entity, read: Callable[[Entity], Read]) -> Read:
    result = read(entity)
    entity.finish()
    return result


def _action(item: Item) -> tuple[str, Item]:
    if not isinstance(item.value, dict) or len(item.value) != 1:
        found = ', '.join(item.value) if isinstance(item.value, dict) else type_name(item.value)
        raise item.place.error(f'an action is a map with one key, its name; found: {found or "an empty map"}')
    [(name, content)] = item.value.items()
    return name, Item(content.value, item.place)


def _load(file: Path) -> Item | None:
    if file.suffix in {'.py', '.xml'}:
        kind = 'Python' if file.suffix == '.py' else 'XML'
        raise LaunchFileError(f'cannot run {file}: {kind} launch files are not supported; use the YAML format')
    try:
        text = read_text(file)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'it is not UTF-8 text'
        raise LaunchFileError(f'cannot read the launch file {file}: {reason}') from error
    return parse_items(text, file)


def parse_items(text: str, file: Path) -> Item | None:
    """The YAML `text` as items; None if it is empty.

    Raises:
        LaunchFileError: not valid YAML, or too large for a launch file.
    """
    loader = _loader(text, file)
    try:
        node = loader.get_single_node()
        return _Converter(loader, file).item(node, 0) if node is not None else None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise LaunchFileError.at(file, line, f'not valid YAML: {error.problem or error.context}') from error
    except RecursionError as error:
        raise LaunchFileError(f'{file}: nested too deeply') from error
    finally:
        loader.dispose()


def _loader(text: str, file: Path) -> yaml.SafeLoader:
    try:
        return yaml.SafeLoader(text)
    except yaml.reader.ReaderError as error:
        line = text.count('\n', 0, error.position) + 1
        raise LaunchFileError.at(file, line, 'a character that YAML does not allow') from error


@dataclass
class _Converter:
    loader: yaml.SafeLoader
    file: Path
    count: int = field(default=0)

    def item(self, node: yaml.Node, depth: int) -> Item:
        place = Place(self.file, node.start_mark.line + 1)
        self.count += 1
        if depth > _MAX_DEPTH or self.count > _MAX_ITEMS:
            raise place.error('nested too deeply, or too large, for a launch file')
        if isinstance(node, yaml.MappingNode):
            return Item(self.mapping(node, depth), place)
        if isinstance(node, yaml.SequenceNode):
            return Item([self.item(each, depth + 1) for each in node.value], place)
        return Item(self.scalar(node, place), place)

    def mapping(self, node: yaml.MappingNode, depth: int) -> Mapping[str, Item]:
        self.loader.flatten_mapping(node)
        result: dict[str, Item] = {}
        for key_node, value_node in node.value:
            key, place = self.item(key_node, depth + 1).value, Place(self.file, key_node.start_mark.line + 1)
            if not isinstance(key, str):
                raise place.error(f'a key must be a str, got {type_name(key)}')
            if key in result:
                raise place.error(f"the key '{key}' is given twice")
            result[key] = Item(self.item(value_node, depth + 1).value, place)
        return result

    def scalar(self, node: yaml.Node, place: Place) -> object:
        if node.tag not in _SCALARS:
            raise place.error(f'the YAML tag {node.tag} is not supported')
        try:
            return self.loader.construct_object(node)
        except (ValueError, LookupError, AttributeError, OverflowError) as error:
            raise place.error(f'{node.value!r} is not a valid {node.tag.rpartition(":")[2]}') from error
