"""Writes descriptions as YAML for people to read and change, with the source of each value."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from tactile_nodes.params import Value, to_values
from tactile_nodes.sensors.description import Sensor
from tactile_nodes.sensors.loading import OF_OTHERS

HEAD = """\
# What is known of this sensor: docs/sensors.md says what each entry means. Change what you know better, and look at it
# with: tactile sensor check
"""


MOUNTING = 'frame.'
ONLY_IF_CHANGED = (
    'gel.outline_mm', 'gel.dome_radius_mm', 'gel.sides', 'bins.width_mm', 'bins.height_mm', 'bins.centre_mm',
    'pattern.dot_mm',
)  # fmt: skip
"""Entries that are written only if they differ from the default: older descriptions do not have them."""


def values_of(sensor: Sensor) -> dict[str, Value]:
    """The dotted names and values that a model depends on: all except the mounting."""
    return {name: value for name, value in _entries_of(sensor).items() if not name.startswith(MOUNTING)}


def _entries_of(sensor: Sensor) -> dict[str, Value]:
    usual = to_values(Sensor())
    values = to_values(sensor)
    return {name: value for name, value in values.items() if name not in ONLY_IF_CHANGED or value != usual[name]}


def text_of(sensor: Sensor, sources: Mapping[str, str]) -> str:
    """The text of a description; `sources` gives the source of values, by dotted name."""
    lines, block = [HEAD.rstrip()], ''
    unused = OF_OTHERS[sensor.camera.model] + OF_OTHERS[sensor.pattern.kind]
    for name, value in _entries_of(sensor).items():
        head, _, key = name.rpartition('.')
        if name in unused or value == []:
            continue
        if head and head != block:
            lines.append(f'{head}:')
            block = head
        source = f'  # {sources[name]}' if name in sources else ''
        lines += _entry('  ' if head else '', key, value, source)
    return '\n'.join(lines) + '\n'


def _entry(indent: str, key: str, value: object, source: str) -> list[str]:
    if isinstance(value, list) and value and isinstance(value[0], str):
        return [f'{indent}{key}:{source}', *(f'{indent}  - {_written(each)}' for each in value)]
    return [f'{indent}{key}: {_written(value)}{source}']


def _written(value: object) -> str:
    """A value with six digits, in a form that YAML and rcl read back."""
    if isinstance(value, list):
        return f'[{", ".join(map(_written, value))}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        short = f'{value:.6g}'
        return short if '.' in short or 'e' in short else f'{short}.0'
    return _quoted(value) if isinstance(value, str) else str(value)


def _quoted(text: str) -> str:
    """A text in quotes on one line, whatever it contains."""
    quoted: str = yaml.safe_dump(text, default_style='"', allow_unicode=True, width=10**6)
    return quoted.rstrip('\n')
