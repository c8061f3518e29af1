"""A sensor's description: read whole, or refused in a sentence that names what contradicts what."""

from pathlib import Path

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensors import load_sensor


def described(folder: Path, text: str) -> Path:
    file = folder / 'sensor.yaml'
    file.write_text(text)
    return file


def test_the_simulated_sensor_ships() -> None:
    sensor = load_sensor('simulated')
    assert sensor.gel.depth_mm == 6.0
    assert sensor.camera.position_mm == (0.0, 0.0, -23.0)
    assert (sensor.bins.rows, sensor.bins.cols) == (9, 9)


def test_what_a_file_leaves_out_is_as_on_the_simulated_sensor(tmp_path: Path) -> None:
    sensor = load_sensor(described(tmp_path, 'name: mine\ngel: {width_mm: 25}\n'))
    assert sensor.gel.width_mm == 25.0
    assert sensor.gel.height_mm == 32.0


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('gel: {layers_mm: [1.5, 4.5], moduli_mpa: [0.1]}', 'gel.moduli_mpa must hold 2 numbers'),
        ('gel: {markers_mm: [1.5, 7.0]}', 'two depths within the 6 mm'),
        ('gel: {poisson_ratios: [0.5, 0.6]}', 'between 0 and 0.5'),
        ('gel: {layers_mm: [0.0, 4.5]}', 'above 0'),
        ('camera: {position_mm: [0.0, 0.0, -5.0]}', 'not below the markers'),
        ('camera: {centre_px: [320.0]}', 'camera.centre_px must hold 2 numbers'),
        ('image: {width: 320, height: 240, crop: 440}', 'only 320x240 pixels'),
        ('image: {with: 320}', "unknown parameter 'image.with'"),
    ],
)
def test_a_description_that_contradicts_itself_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(described(tmp_path, text))


def test_a_sensor_that_is_not_there_is_told_with_those_that_ship() -> None:
    with pytest.raises(ConfigurationError, match=r"no sensor 'other'.*simulated"):
        load_sensor('other')
