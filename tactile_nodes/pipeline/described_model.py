"""Checks that a model belongs to the described sensor whose images it reads."""

from __future__ import annotations

import shlex
from pathlib import Path

from tactile_nodes.errors import ModelError
from tactile_nodes.model_file import SENSOR
from tactile_nodes.pipeline.ready_model import Ready
from tactile_nodes.sensors import load_sensor
from tactile_nodes.sensors.writing import values_of


def require_of_sensor(ready: Ready, sensor: str) -> None:
    """Refuse a model of another sensor; `sensor` is the name or file of the description, or empty.

    Raises:
        ConfigurationError: there is no such description.
        ModelError: the images are cropped to another size than the model reads, or the model was made from a
            description of another name. (A description of the same name may have changed a little since, for example
            by a calibration.)
    """
    if not sensor:
        return
    described, card = load_sensor(sensor), ready.loaded.card.get(SENSOR, {})
    size, reads = described.image.crop_px, ready.inputs.image_size
    now = values_of(described)
    other = card.get('name', described.name) != described.name and any(
        now[key] != value for key, value in card.items() if key in now and key != 'name'
    )
    if size == reads and not other:
        return
    why = (
        f'it was made from the description {card["name"]}'
        if size == reads
        else f'it reads images of {_size(reads)}, and this sensor gives {_size(size)}'
    )
    made = f'{Path(sensor).stem}.safetensors'
    command = shlex.join(['tactile', 'calibrate', '--sensor', sensor, '--model', 'field', '-o', made])
    raise ModelError(
        f'model {ready.name} does not belong to sensor {sensor}: {why}; make one with `{command}` and start with '
        f'model:={shlex.quote(made)}'
    )


def _size(size: tuple[int, int]) -> str:
    return f'{size[0]}x{size[1]}'
