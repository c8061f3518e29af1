"""Frozen dataclasses as blocks of parameters: declares, describes, fills and validates them."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params.files import Located, Scalar, Value

Block = TypeVar('Block')


@dataclass(frozen=True)
class ParameterDescription:
    """The description that a node declares for one parameter."""

    name: str
    type: str
    default: object
    description: str
    minimum: float | None
    maximum: float | None
    choices: tuple[Scalar, ...] | None
    read_only: bool


def parameter(
    default: Any,
    description: str = '',
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[Scalar] | None = None,
    read_only: bool | None = None,
) -> Any:
    """A field of a parameter block; `read_only` means that a change needs a restart of the node.

    The default of that is ``READ_ONLY: ClassVar[bool]`` of its block, then that of the enclosing block. Numbers are
    finite, unless `maximum` is not.
    """
    return dataclasses.field(
        default=default,
        metadata={
            'description': description,
            'minimum': minimum,
            'maximum': maximum,
            'choices': tuple(choices) if choices is not None else None,
            'read_only': read_only,
        },
    )


def from_mapping(
    block: type[Block], values: Mapping[str, object], *, source: str = 'parameters', exact: bool = True
) -> Block:
    """An instance of the frozen dataclass `block` with these dotted names set.

    Args:
        block: a frozen dataclass of `parameter()` fields and nested such dataclasses.
        values: plain values, or `Located` ones, whose place is then named in errors.
        source: where the values come from, for errors.
        exact: refuse an integer where a float is declared, as ROS 2 does.

    Raises:
        ConfigurationError: an unknown name, a wrong type, a value out of range, or values that the block refuses (a
        `ValueError` from its ``__post_init__``).
    """
    names = {description.name for description in describe(block)}
    for name, value in values.items():
        if name not in names:
            raise _at(value, source, f'unknown parameter {name!r}; available: {", ".join(sorted(names))}')
    try:
        return typing.cast(Block, _build(block, '', values, source, exact))
    except ValueError as error:
        raise ConfigurationError(f'{source}: {error}') from error


def describe(block: type[Any]) -> list[ParameterDescription]:
    """The parameters of a block, by dotted name, in order of declaration."""
    return list(_describe(block, '', read_only=False))


def to_values(block: object, prefix: str = '') -> dict[str, Value]:
    """The dotted names and values of a block: the reverse of `from_mapping`."""
    values: dict[str, Value] = {}
    for field in dataclasses.fields(block):  # type: ignore[arg-type]
        value = getattr(block, field.name)
        if dataclasses.is_dataclass(value):
            values.update(to_values(value, f'{prefix}{field.name}.'))
        else:
            values[prefix + field.name] = list(value) if isinstance(value, tuple) else value
    return values


def _describe(block: type[Any], prefix: str, *, read_only: bool) -> Iterable[ParameterDescription]:
    hints = typing.get_type_hints(block)
    read_only = getattr(block, 'READ_ONLY', read_only)
    for field in dataclasses.fields(block):
        hint = hints[field.name]
        if dataclasses.is_dataclass(hint):
            yield from _describe(typing.cast(type[Any], hint), f'{prefix}{field.name}.', read_only=read_only)
            continue
        facts = field.metadata
        own = facts.get('read_only')
        yield ParameterDescription(
            prefix + field.name,
            _type_name(hint),
            field.default,
            facts.get('description', ''),
            facts.get('minimum'),
            facts.get('maximum'),
            facts.get('choices'),
            read_only if own is None else own,
        )


def _type_name(hint: Any) -> str:
    if typing.get_origin(hint) is tuple:
        return f'{typing.get_args(hint)[0].__name__}_array'
    return str(hint.__name__)


def _build(block: Any, prefix: str, values: Mapping[str, object], source: str, exact: bool) -> Any:
    hints = typing.get_type_hints(block)
    given: dict[str, object] = {}
    for field in dataclasses.fields(block):
        name, hint = prefix + field.name, hints[field.name]
        if dataclasses.is_dataclass(hint):
            given[field.name] = _build(hint, f'{name}.', values, source, exact)
        elif name in values:
            given[field.name] = _checked(name, hint, field.metadata, values[name], source, exact)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ConfigurationError(f'{source}: {name!r} is missing')
    return block(**given)


def _checked(name: str, hint: Any, facts: Mapping[str, Any], written: object, source: str, exact: bool) -> object:
    value = written.value if isinstance(written, Located) else written
    low, high, choices = facts.get('minimum'), facts.get('maximum'), facts.get('choices')
    finite = high != math.inf
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, (list, tuple)):
            raise _at(written, source, f'{name!r} must be a list, got {value!r}')
        inner = typing.get_args(hint)[0]
        return tuple(_of_type(name, inner, item, written, source, exact, finite) for item in value)
    value = _of_type(name, hint, value, written, source, exact, finite)
    if choices is not None and value not in choices:
        raise _at(written, source, f'{name!r} must be one of {", ".join(map(repr, choices))}, got {value!r}')
    if (low is not None and not typing.cast(float, value) >= low) or (
        high is not None and not typing.cast(float, value) <= high
    ):
        raise _at(written, source, f'{name!r} must be {_range(low, high)}, got {value!r}')
    return value


def _of_type(name: str, hint: Any, value: object, written: object, source: str, exact: bool, finite: bool) -> object:
    if isinstance(value, float) and math.isnan(value):  # no comparison with it would hold a limit
        raise _at(written, source, f'{name!r} must be a number, got {value!r}')
    if finite and isinstance(value, float) and math.isinf(value):  # such a limit would limit nothing
        raise _at(written, source, f'{name!r} must be finite, got {value!r}')
    if isinstance(value, str) and '\0' in value:  # no path and no name can hold it
        raise _at(written, source, f'{name!r} must not contain a NUL character, got {value!r}')
    if type(value) is hint:
        return value
    if hint is float and type(value) is int and not exact:
        return float(value)
    wish = f'; write {value}.0' if hint is float and type(value) is int else ''
    wish = f'; put it in quotes: "{value}"' if hint is str else wish
    raise _at(written, source, f'{name!r} must be a {hint.__name__}, got {value!r} ({type(value).__name__}){wish}')


def _range(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f'from {low} to {high}'
    return f'at least {low}' if low is not None else f'at most {high}'


def _at(written: object, source: str, text: str) -> ConfigurationError:
    if isinstance(written, Located):
        return ConfigurationError.at(written.source, written.line, text)
    return ConfigurationError(f'{source}: {text}')
