"""Descriptions read from their files, with the files that they name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import Located, from_mapping, load_mapping
from tactile_nodes.paths import share_directory
from tactile_nodes.sensors.camera_file import read_camera_file
from tactile_nodes.sensors.description import Sensor

CALIBRATION = 'camera.calibration'
"""Names a file; what that says stands in the description instead."""


def load_sensor(name: Path | str) -> Sensor:
    """A description by the name of one that ships ('simulated'), or its file.

    Raises:
        ConfigurationError: there is none, an unknown key, or numbers that contradict each other.
    """
    shipped = share_directory() / 'config' / 'sensors' / f'{name}.yaml'
    file = shipped if shipped.is_file() else Path(name)
    if not file.is_file():
        known = ', '.join(sorted(each.stem for each in shipped.parent.glob('*.yaml')))
        raise ConfigurationError(f'there is no sensor {str(name)!r}; give a YAML file, or one that ships: {known}')
    return from_mapping(Sensor, _calibrated(load_mapping(file), file), source=str(file), exact=False)


def _calibrated(written: Mapping[str, Located], file: Path) -> dict[str, object]:
    """What is written, with what a calibration says in place of its name."""
    values: dict[str, object] = dict(written)
    if CALIBRATION not in written:
        return values
    named = written[CALIBRATION]
    del values[CALIBRATION]
    if not isinstance(named.value, str):
        raise ConfigurationError.at(named.source, named.line, f'{CALIBRATION!r} must name a file, got {named.value!r}')
    model = written['camera.model'].value if 'camera.model' in written else ''
    told = read_camera_file(file.parent / Path(named.value).expanduser(), str(model))
    for key, value in told.items():
        if key in written and written[key].value != value:
            raise ConfigurationError.at(
                written[key].source,
                written[key].line,
                f'{key!r} is {written[key].value!r}, and the calibration {named.value} says {value!r}; remove one',
            )
    return values | told
