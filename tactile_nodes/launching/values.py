"""Strings to typed values, with the rules by which ROS 2's launch reads the result of a substitution.

Those rules are YAML's (1.1, so ``010`` is eight and ``on`` is true). A string to YAML is then written into a parameter
file without quotes, and rcl reads it by its own rules: ``1e5`` and ``y`` become a number and a boolean.
"""

from __future__ import annotations

import math
from typing import Any

import yaml

from tactile_nodes.launching.document import type_name
from tactile_nodes.launching.template import SubstitutionError
from tactile_nodes.params import parse_scalar

SCALARS: dict[str, type] = {'str': str, 'bool': bool, 'int': int, 'float': float}
TYPES = (*SCALARS, *(f'list_of_{name}' for name in SCALARS))


def condition(text: str) -> bool:
    """The value of ``if`` and ``unless``: true, 1, false or 0, in any case."""
    word = text.strip().lower()
    if word not in {'true', '1', 'false', '0'}:
        raise SubstitutionError(f"a condition must be 'true', '1', 'false' or '0', got '{text}'")
    return word in {'true', '1'}


def boolean(text: str) -> bool:
    """A boolean as YAML writes it: true, yes, on, …"""
    value = _yaml(text)
    if not isinstance(value, bool):
        raise SubstitutionError(f"'{text}' is not a boolean")
    return value


def number(text: str) -> float:
    """A number, for example of seconds."""
    try:
        value = float(text)
    except ValueError as error:
        raise SubstitutionError(f"'{text}' is not a number") from error
    if not math.isfinite(value):
        raise SubstitutionError(f"'{text}' is not a finite number")
    return value


def guessed(text: str) -> Any:
    """The value that a node gets from a string in a parameter: a bool, int, float, str, or a list of one of these.

    >>> guessed('00012345'), guessed('1e5'), guessed('1.5'), guessed('on')
    (5349, 100000.0, 1.5, True)
    """
    value = from_yaml(text)
    return parse_scalar(value) if isinstance(value, str) and retyped(value) else value


def from_yaml(text: str) -> Any:
    """The value of a string in YAML, if a parameter can hold it.

    >>> from_yaml('00012345'), from_yaml('1e5'), from_yaml('[1, 2]')
    (5349, '1e5', [1, 2])
    """
    value = _yaml(text)
    if isinstance(value, list):
        return uniform(value)
    if type(value) not in SCALARS.values():
        raise SubstitutionError(
            f"'{text}' is {type_name(value)} in YAML, which no parameter holds; for the string itself give 'type: str'"
        )
    return value


def retyped(text: str) -> bool:
    """Whether ROS 2 passes a string as another type: YAML writes it without quotes, and rcl does not read a string."""
    return not isinstance(parse_scalar(text), str) and _yaml(text) == text


def as_type(text: str, kind: str) -> Any:
    """A string as the type that the file requests with ``type:``."""
    if kind == 'str':
        return text
    if kind.startswith('list_of_'):
        return _checked(_yaml(text), kind)
    if kind == 'bool':
        return boolean(text)
    try:
        return SCALARS[kind](text)
    except ValueError as error:
        raise SubstitutionError(f"'{text}' is not a valid {kind}") from error


def literal(value: Any, kind: str | None) -> Any:
    """A value as written in the file; it must already have the requested type."""
    if kind is not None:
        return _checked(value, kind)
    if isinstance(value, list):
        return uniform(value)
    if type(value) not in SCALARS.values():
        raise SubstitutionError(f'{type_name(value)} cannot be a parameter')
    return value


def uniform(values: list[Any]) -> list[Any]:
    """A list that a parameter can hold: not empty, all bool, all int, all float or all str."""
    kinds = {type(value) for value in values}
    if len(kinds) != 1 or not kinds <= set(SCALARS.values()):
        found = ', '.join(sorted(map(type_name, values))) or 'nothing'
        raise SubstitutionError(f'a list parameter must hold values of one type, got {found}')
    return values


def _checked(value: Any, kind: str) -> Any:
    name = kind.removeprefix('list_of_')
    values = value if name != kind else [value]
    if not isinstance(values, list) or not values or any(type(each) is not SCALARS[name] for each in values):
        raise SubstitutionError(f"'{value}' is not of 'type: {kind}', and ROS 2 does not convert it")
    return value


def _yaml(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        raise SubstitutionError(f"'{text}' cannot be read as YAML; for the string itself give 'type: str'") from error
