"""Parameter files as ROS 2 reads them: rcl's rules for scalars, lists, node names and precedence."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_text

Scalar = bool | int | float | str
Value = Scalar | list[bool] | list[int] | list[float] | list[str]

_PLAIN = '!plain'
_TRUE = {'y', 'Y', 'yes', 'Yes', 'YES', 'true', 'True', 'TRUE', 'on', 'On', 'ON'}
_FALSE = {'n', 'N', 'no', 'No', 'NO', 'false', 'False', 'FALSE', 'off', 'Off', 'OFF'}
_INTEGER = re.compile(r'\s*[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_DECIMAL = re.compile(r'\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?')
_NOT_FINITE = re.compile(r'[+-]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)')


class _Loader(yaml.SafeLoader):
    """Marks unquoted scalars instead of typing them by YAML 1.1, whose rules differ from rcl's."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        return _PLAIN if kind is yaml.ScalarNode and implicit[0] else super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]


@dataclass(frozen=True)
class Located:
    """A value and its place in a source (`line` counts from 1; None on a command line)."""

    value: Value
    source: str
    line: int | None = None


@dataclass(frozen=True)
class NodeParameters:
    """The values that one source sets for one node pattern, by dotted name."""

    pattern: str
    values: Mapping[str, Located]


def parse_scalar(text: str) -> Scalar:
    """Parse an unquoted scalar as rcl_yaml_param_parser does: bool, integer (C ``strtoll``, base 0), double, string.

    >>> parse_scalar('0x10'), parse_scalar('010'), parse_scalar('1e-3'), parse_scalar('on'), parse_scalar('1.2.3')
    (16, 8, 0.001, True, '1.2.3')
    """
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text) and -(2**63) <= (number := _c_integer(text)) < 2**63:
        return number
    if _DECIMAL.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace('.', '', 1))
    return text


class _Dumper(yaml.SafeDumper):
    """Quotes the strings that rcl would convert, and writes no aliases."""

    def ignore_aliases(self, _: Any) -> bool:
        return True


def _string(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    plain = text and isinstance(parse_scalar(text), str)
    return dumper.represent_scalar('tag:yaml.org,2002:str', text, style=None if plain else "'")


_Dumper.add_representer(str, _string)


def parameter_file_text(blocks: Mapping[str, Mapping[str, Any]]) -> str:
    """A parameter file with these values by node pattern and name, which reads back identically."""
    tree = {pattern: {'ros__parameters': dict(values)} for pattern, values in blocks.items()}
    return yaml.dump(tree, Dumper=_Dumper, default_flow_style=False, allow_unicode=True, width=10**6, sort_keys=False)


def load_parameter_file(path: str | Path) -> list[NodeParameters]:
    """The blocks of a ROS 2 parameter file, in file order.

    Raises:
        ConfigurationError: no such file, not YAML, or not of the form ``node: ros__parameters: {…}``.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'cannot read the parameter file {path}: {error}') from error
    return parse_parameters(text, str(path))


def parse_parameters(text: str, source: str) -> list[NodeParameters]:
    """Like `load_parameter_file`, for a text; `source` is its name in errors."""
    root = compose(text, source)
    if root is None:
        return []
    if not isinstance(root, yaml.MappingNode):
        raise _refusal(source, root, 'a parameter file maps node names to ros__parameters')
    return list(_node_blocks(root, '', source))


def parse_value(text: str, source: str, name: str) -> Located:
    """The value `text` of the parameter `name`, read alone, as rcl reads ``-p``: ``a, b`` is one string.

    Raises:
        ConfigurationError: not YAML, empty, or no scalar and no list of scalars.
    """
    node = compose(text, source)
    if node is None:
        raise ConfigurationError(f'{source}: {name!r} has no value')
    if isinstance(node, yaml.MappingNode):
        raise _refusal(source, node, f'{name!r} cannot hold a map; put the text in quotes, or set {name}.key')
    return Located(_value(node, source, name), source, _line(node.start_mark))


def load_mapping(path: str | Path) -> dict[str, Located]:
    """A plain YAML file with one mapping (a gel, a training run), flattened to dotted names, typed by the same rules.

    Raises:
        ConfigurationError: no such file, not YAML, not a mapping.
    """
    root = _mapping(path)
    return dict(_flat(root, '', str(path))) if root else {}


def load_listed(path: str | Path, key: str) -> tuple[dict[str, Located], list[dict[str, Located] | ConfigurationError]]:
    """Like `load_mapping`, for a file with a list of mappings under `key`: returns the rest, and the list.

    An invalid list entry is returned as its error, because other entries may be valid.

    Raises:
        ConfigurationError: as `load_mapping`, or there is no such list.
    """
    root, source = _mapping(path), str(path)
    pairs = root.value if root else []
    listed = next((value for name, value in pairs if name.value == key), None)
    if not isinstance(listed, yaml.SequenceNode) or not listed.value:
        raise ConfigurationError(f'{source}: it must hold a list {key!r}')
    rest = yaml.MappingNode('tag:yaml.org,2002:map', [pair for pair in pairs if pair[1] is not listed])
    return dict(_flat(rest, '', source)), [_entry(each, key, source) for each in listed.value]


def _entry(node: yaml.Node, key: str, source: str) -> dict[str, Located] | ConfigurationError:
    try:
        if not isinstance(node, yaml.MappingNode) or not node.value:
            raise _refusal(source, node, f'each of {key!r} maps names to values')
        return dict(_flat(node, '', source))
    except ConfigurationError as error:
        return error


def _mapping(path: str | Path) -> yaml.MappingNode | None:
    try:
        root = compose(read_text(path), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'cannot read {path}: {error}') from error
    if root is not None and not isinstance(root, yaml.MappingNode):
        raise _refusal(str(path), root, 'expected a mapping of names to values')
    _require_each_once(root, str(path))
    return root


def _require_each_once(node: yaml.Node | None, source: str) -> None:
    """Raise ConfigurationError if a key is given twice, because it is unclear which value is meant."""
    if isinstance(node, yaml.SequenceNode):
        for each in node.value:
            _require_each_once(each, source)
    if isinstance(node, yaml.MappingNode):
        patterns = set()
        for key, value in node.value:
            name = str(key.value)
            if name in patterns:
                raise _refusal(source, key, f'{name!r} is given twice')
            patterns.add(name)
            _require_each_once(value, source)


def compose(text: str, source: str) -> yaml.Node | None:
    """The YAML tree of `text` with its line marks; aliases are refused, as in rcl.

    Raises:
        ConfigurationError: not YAML.
    """
    try:
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent):
                raise ConfigurationError.at(source, _line(event.start_mark), 'aliases are not supported here')
        return yaml.compose(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, 'problem_mark', None)
        reason = getattr(error, 'problem', None) or str(error).split('\n', maxsplit=1)[0]
        raise ConfigurationError.at(source, _line(mark), f'not valid YAML: {reason}') from error
    except RecursionError as error:
        raise ConfigurationError(f'{source}: the YAML is nested too deeply') from error


def _line(mark: Any) -> int | None:
    return mark.line + 1 if mark is not None else None


def _c_integer(text: str) -> int:
    sign, digits = re.fullmatch(r'\s*([+-]?)(.*)', text).groups()  # type: ignore[union-attr]
    base = 16 if digits[:2] in {'0x', '0X'} else 8 if digits.startswith('0') else 10
    return int(digits, base) * (-1 if sign == '-' else 1)


def _node_blocks(mapping: yaml.MappingNode, namespace: str, source: str) -> Iterable[NodeParameters]:
    for key, child in mapping.value:
        name = _key(key, source)
        pattern = f'{namespace}/{name.strip("/")}'
        if not isinstance(child, yaml.MappingNode):
            raise _refusal(source, child, f'{name!r} must hold ros__parameters or further node names')
        parameters = [value for inner, value in child.value if _key(inner, source) == 'ros__parameters']
        if not parameters:
            yield from _node_blocks(child, pattern, source)
            continue
        if not isinstance(parameters[-1], yaml.MappingNode):
            raise _refusal(source, parameters[-1], f'ros__parameters of {name!r} must map names to values')
        yield NodeParameters(pattern, dict(_flat(parameters[-1], '', source)))


def _flat(mapping: yaml.MappingNode, prefix: str, source: str) -> Iterable[tuple[str, Located]]:
    for key, child in mapping.value:
        name = prefix + _key(key, source)
        if isinstance(child, yaml.MappingNode):
            yield from _flat(child, f'{name}.', source)
        else:
            yield name, Located(_value(child, source, name), source, _line(child.start_mark))


def _key(node: yaml.Node, source: str) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise _refusal(source, node, 'expected a name')
    return str(node.value)


def _value(node: yaml.Node, source: str, name: str) -> Value:
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node, source, name)
    items = [_scalar(item, source, name) for item in node.value]
    kinds = {type(item) for item in items}
    if len(kinds) > 1:
        found = ' and '.join(sorted(kind.__name__ for kind in kinds))
        hint = ': write 0.0 for 0' if kinds == {int, float} else ''
        raise _refusal(source, node, f'the list {name!r} mixes {found}; a list holds one type{hint}')
    return typing.cast(Value, items)


def _scalar(node: yaml.Node, source: str, name: str) -> Scalar:
    if not isinstance(node, yaml.ScalarNode):
        raise _refusal(source, node, f'{name!r} holds a list of lists or maps, which a parameter cannot')
    if node.tag != _PLAIN:  # quoted, literal, folded, or tagged !!str
        return str(node.value)
    if node.value == '':
        raise _refusal(source, node, f'{name!r} has no value')
    return parse_scalar(node.value)


def _refusal(source: str, node: yaml.Node, text: str) -> ConfigurationError:
    return ConfigurationError.at(source, _line(node.start_mark), text)


def resolve_parameters(node_name: str, blocks: Iterable[NodeParameters]) -> dict[str, Located]:
    """The values that apply to the node with this full name (``/skin/camera``), by rcl's precedence.

    All blocks are merged into one list of patterns, ordered by first appearance. Within a pattern the later value wins.
    The matching patterns then apply in that order, and the later one wins.
    """
    merged: dict[str, dict[str, Located]] = {}
    for block in blocks:
        merged.setdefault(normal_pattern(block.pattern), {}).update(block.values)
    found: dict[str, Located] = {}
    for pattern, values in merged.items():
        if matches(pattern, node_name):
            found.update(values)
    return found


def exact_names(node_name: str, blocks: Iterable[NodeParameters]) -> set[str]:
    """The parameters of blocks that name the node (``/**/camera``), in which an unknown name is an error."""
    own = node_name.rpartition('/')[2]
    naming = [
        block for block in blocks if block.pattern.rpartition('/')[2] == own and matches(block.pattern, node_name)
    ]
    return {name for block in naming for name in block.values}


def normal_pattern(pattern: str) -> str:
    """A node pattern with its leading slash."""
    return '/' + pattern.lstrip('/')


def matches(pattern: str, node_name: str) -> bool:
    """Whether a node pattern (``*`` one level, ``**`` any depth) matches a full node name.

    >>> matches('/**', '/skin/camera'), matches('/*/camera', '/skin/camera'), matches('/camera', '/skin/camera')
    (True, True, False)
    """
    expression = re.escape(normal_pattern(pattern))
    expression = expression.replace(r'/\*\*', r'(/\w+)*').replace(r'\*', r'\w+')
    return re.fullmatch(expression, node_name) is not None
