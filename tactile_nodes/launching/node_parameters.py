"""The ``param`` of a node: a parameter file, or values that are written into one.

ROS 2 writes every inline ``param`` into its own file, and passes files and inline values in the order of the launch
file, because the order decides which value wins.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import yaml

from tactile_nodes import params
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_text
from tactile_nodes.launching import values
from tactile_nodes.launching.document import Entity, Item, type_name
from tactile_nodes.launching.template import Call, Place, SubstitutionError, Template, parse_template

if TYPE_CHECKING:
    from tactile_nodes.launching.context import Context
    from tactile_nodes.launching.interpreter import Interpreter


class NodeParameter(Protocol):
    """One ``param`` of a node."""

    def file(self, run: Interpreter, node: str | None, /) -> Path:
        """The parameter file to pass; `node` is the node's full name if the launch file gives it."""
        ...


@dataclass(frozen=True)
class ParameterFile:
    """``param: [{from: …}]``."""

    path: Template
    substitute: bool
    place: Place

    def file(self, run: Interpreter, _node: str | None, /) -> Path:
        path = Path(self.path.evaluate(run.context))
        if not path.is_file():
            named = [part.arguments[0] for part in self.path.parts if isinstance(part, Call) and part.name == 'var']
            remedy = f'; give another one with {named[0]}:=FILE' if named else ''
            raise self.place.error(f'the parameter file {path} does not exist{remedy}')
        if self.substitute:
            path = run.write_parameters(self._substituted(path, run.context))
        _check(path)
        return path

    def _substituted(self, path: Path, context: Context) -> str:
        # ROS 2 makes substitutions in the file after YAML has rewritten it, without comments and with sorted keys.
        try:
            text = yaml.safe_dump(yaml.safe_load(read_text(path)))
        except (OSError, yaml.YAMLError, ValueError, LookupError, AttributeError) as error:
            raise self.place.error(f'the parameter file {path} cannot be read as YAML: {error}') from error
        return parse_template(text, Place(path, 1)).evaluate(context)


@dataclass(frozen=True)
class Value:
    """The content of ``value:``, with the type requested by ``type:``."""

    content: Any  # a scalar, a Template with substitutions, or a list of these
    kind: str | None

    def evaluate(self, context: Context) -> Any:
        if isinstance(self.content, Template):
            text = self.content.evaluate(context)
            return values.guessed(text) if self.kind is None else values.as_type(text, self.kind)
        if isinstance(self.content, list):
            inner = self.kind.removeprefix('list_of_') if self.kind else None
            return values.uniform([Value(each, inner).evaluate(context) for each in self.content])
        return self.content


@dataclass(frozen=True)
class InlineParameter:
    """``param: [{name: …, value: …}]``, or nested ones; nested names are joined by dots."""

    entries: tuple[Entry, ...]

    def file(self, run: Interpreter, node: str | None, /) -> Path:
        found = dict(entry.evaluate(run.context) for entry in self.entries)
        return run.write_parameters(params.parameter_file_text({node or '/**': found}))


@dataclass(frozen=True)
class Entry:
    """One name and value of an inline ``param``; nested names are joined by dots."""

    names: tuple[Template, ...]
    value: Value
    place: Place

    def evaluate(self, context: Context) -> tuple[str, Any]:
        about = 'name'
        try:
            about = '.'.join(each.evaluate(context) for each in self.names)
            return about, self.value.evaluate(context)
        except SubstitutionError as error:
            raise self.place.error(f'param: {about}: {error}') from error


def read_parameter(entity: Entity) -> NodeParameter:
    """One ``param`` of a node.

    Raises:
        LaunchFileError: neither name nor from, both, or an invalid value.
    """
    file, name = entity.template_or_none('from'), entity.template_or_none('name')
    if (file is None) == (name is None):
        raise entity.place.error("param: exactly one of 'name' and 'from' is needed")
    if file is not None:
        parameter: NodeParameter = ParameterFile(file, entity.boolean('allow_substs', default=False), entity.place)
        entity.finish()
        return parameter
    return InlineParameter(tuple(_entries(entity, ())))


def _entries(entity: Entity, outer: tuple[Template, ...]) -> list[Entry]:
    names = (*outer, entity.template('name'))
    kind, item, nested = entity.text_or_none('type'), entity.item_or_none('value'), entity.entities('param')
    entity.finish()
    if (item is None) == (not nested) or (kind and nested):
        raise entity.place.error(
            "param: exactly one of 'value' and nested 'param' is needed ('type' goes with 'value')"
        )
    if kind is not None and kind not in values.TYPES:
        raise entity.place.error(f"param: 'type' is one of {', '.join(values.TYPES)}, got '{kind}'")
    if item is not None:
        return [Entry(names, _read_value(item, kind), entity.place)]
    return [entry for each in nested for entry in _entries(each, names)]


def _read_value(item: Item, kind: str | None) -> Value:
    content = _content(item)
    mixed = isinstance(content, Template) or (
        isinstance(content, list) and any(isinstance(each, Template) for each in content)
    )
    try:
        if not mixed:
            _check_literal(values.literal(content, kind))
    except SubstitutionError as error:
        raise item.place.error(f'param: {error}') from error
    return Value(content, kind)


def _content(item: Item) -> Any:
    if isinstance(item.value, str):
        template = parse_template(item.value, item.place)
        return template if template.literal is None else template.literal
    if isinstance(item.value, list):
        return [_content(each) for each in item.value]
    if isinstance(item.value, dict):
        raise item.place.error(f"param: 'value' is {type_name(item.value)}; for nested values write nested 'param'")
    return item.value


def _check_literal(value: Any) -> None:
    for text in value if isinstance(value, list) else [value]:
        if isinstance(text, str) and values.retyped(text):
            kind = type(params.parse_scalar(text)).__name__
            raise SubstitutionError(f"ROS 2 passes the string '{text}' as a {kind}; choose another string")


def _check(path: Path) -> None:
    try:
        params.load_parameter_file(path)
    except ConfigurationError as error:
        raise SubstitutionError(str(error)) from error
