"""Checks that a model belongs to the described sensor whose images it reads."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactile_nodes.errors import ModelError
from tactile_nodes.model_file import SENSOR
from tactile_nodes.params import to_values
from tactile_nodes.pipeline.ready_model import Ready
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.sensors.writing import ONLY_IF_CHANGED, values_of


def require_of_sensor(ready: Ready, sensor: str) -> None:
    """Refuse a model of another sensor; `sensor` is the name or file of the description, or empty.

    Raises:
        ConfigurationError: there is no such description.
        ModelError: the images are cropped to another size than the model reads, or the model was made from a
            description of another name. (For one of the same name see `changed_since`.)
    """
    if not sensor:
        return
    described, card = load_sensor(sensor), ready.loaded.card.get(SENSOR, {})
    size, reads = described.image.crop_px, ready.inputs.image_size
    other = card.get('name', described.name) != described.name and _unlike(described, card)
    if size == reads and not other:
        return
    why = (
        f'it was made from the description {card["name"]}'
        if size == reads
        else f'it reads images of {_size(reads)}, and this sensor gives {_size(size)}'
    )
    raise ModelError(f'model {ready.name} does not belong to sensor {sensor}: {why}; {_remedy(sensor)}')


def changed_since(ready: Ready, sensor: str) -> str:
    """How the description of a sensor differs from the one that a model was made from; empty if it does not.

    Raises:
        ConfigurationError: there is no such description.
    """
    unlike = _unlike(load_sensor(sensor), ready.loaded.card.get(SENSOR, {})) if sensor else []
    if not unlike:
        return ''
    return (
        f'the description {sensor} has changed since model {ready.name} was made ({", ".join(unlike)}), and the model '
        f'still uses the old one; {_remedy(sensor)}'
    )


def _unlike(described: Sensor, card: Mapping[str, Any]) -> list[str]:
    """The entries that differ, in words; none if the card describes no sensor."""
    if not card:
        return []
    usual = to_values(Sensor())
    unwritten = {name: usual[name] for name in ONLY_IF_CHANGED}
    now = unwritten | values_of(described)
    return [
        f'{key} was {value}, is {now[key]}'
        for key, value in {**unwritten, **card}.items()
        if key in now and key != 'name' and now[key] != value
    ]


def _remedy(sensor: str) -> str:
    model_file = f'{Path(sensor).stem}.safetensors'
    command = shlex.join(['tactile', 'calibrate', '--sensor', sensor, '--model', 'field', '-o', model_file])
    return f'make one with `{command}` and start with model:={shlex.quote(model_file)}'


def _size(size: tuple[int, int]) -> str:
    return f'{size[0]}x{size[1]}'
