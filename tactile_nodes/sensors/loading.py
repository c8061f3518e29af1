"""Loads descriptions from their files, with the files that they name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import Located, from_mapping, load_mapping
from tactile_nodes.paths import described_in
from tactile_nodes.sensors.camera_file import read_camera_file
from tactile_nodes.sensors.covering import mask_of
from tactile_nodes.sensors.description import Sensor
from tactile_nodes.sensors.mounting import Mounting

OF_OTHERS = {
    'pinhole': ('camera.focal_px_per_rad', 'camera.focal_ratio'), 'fisheye': ('camera.focal_px',),
    'dots': ('pattern.count',), 'spheres': ('pattern.pitch_mm', 'pattern.dot_mm'),
}  # fmt: skip
"""Entries without meaning for a lens model or a kind of pattern."""

CALIBRATION, MASK = 'camera.calibration', 'mask.file'
"""Entries that name files; the contents of these files replace them in the description."""


def load_sensor(name: Path | str) -> Sensor:
    """A description by the name of a shipped one ('simulated'), or by its file.

    Raises:
        ConfigurationError: there is no such description, it is empty, has an unknown key, or its values contradict.
    """
    file = described_in('sensors', name, 'sensor')
    written = load_mapping(file)
    if not written:
        raise ConfigurationError(f'{file} is empty: write a description with `tactile sensor new` (docs/sensors.md)')
    values = _calibrated(written, file)
    values.pop(MASK, None)
    sensor = from_mapping(Sensor, values, source=str(file), exact=False)
    for kind in (sensor.camera.model, sensor.pattern.kind):
        for key in filter(written.__contains__, OF_OTHERS[kind]):
            text = f'{key!r} has no effect with {kind!r}; remove it, or correct camera.model or pattern.kind'
            raise ConfigurationError.at(written[key].source, written[key].line, text)
    if MASK not in written:
        return sensor
    if sensor.mask.polygons_px:
        raise ConfigurationError(f'{file}: it has both mask.file and mask.polygons_px; remove one')
    try:
        mask = mask_of(_beside(file, MASK, written), sensor.image.width, sensor.image.height)
        return replace(sensor, mask=mask)
    except ValueError as error:
        raise ConfigurationError(f'{file}: {error}') from error


def mounting_of(name: Path | str) -> Mounting:
    """The mounting of a described sensor; the default mounting if no name is given.

    Raises:
        ConfigurationError: as `load_sensor`.
    """
    return load_sensor(name).frame if name else Mounting()


def _beside(file: Path, key: str, written: Mapping[str, Located]) -> Path:
    """A file that a description names, relative to the description."""
    named = written[key]
    if not isinstance(named.value, str):
        raise ConfigurationError.at(named.source, named.line, f'{key!r} must name a file, got {named.value!r}')
    return file.parent / Path(named.value).expanduser()


def _calibrated(written: Mapping[str, Located], file: Path) -> dict[str, object]:
    """The entries of a description, with the values of the camera calibration in place of its name."""
    values: dict[str, object] = dict(written)
    if CALIBRATION not in written:
        return values
    del values[CALIBRATION]
    model = written['camera.model'].value if 'camera.model' in written else ''
    calibration = read_camera_file(_beside(file, CALIBRATION, written), str(model))
    for key, value in calibration.items():
        if key in written and written[key].value != value:
            text = f'{key!r} is {written[key].value!r}, but the calibration says {value!r}; remove one'
            raise ConfigurationError.at(written[key].source, written[key].line, text)
    return values | calibration
