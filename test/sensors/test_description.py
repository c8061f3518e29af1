"""A sensor's description: read whole, or refused in a sentence that names what contradicts what."""

from dataclasses import replace
from pathlib import Path

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensors import MaskSettings, load_sensor
from tactile_nodes.sensors.writing import text_of


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


def test_a_part_that_is_no_square_is_cut() -> None:
    assert load_sensor('speckle_membrane').image.crop_px == (640, 480)
    assert load_sensor('simulated').image.crop_px == (440, 440)


def test_a_camera_is_described_as_opencv_and_ros_write_it(tmp_path: Path) -> None:
    lens = 'distortion: [0.1, 0.0, 0.0, 0.0, 0.0]'
    text = f'camera: {{model: pinhole, focal_px: [500.0, 510.0], centre_px: [320.0, 240.0], {lens}}}'
    camera = load_sensor(described(tmp_path, text)).camera
    assert camera.distortion_model == 'plumb_bob'
    assert camera.matrix == ((500.0, 0.0, 320.0), (0.0, 510.0, 240.0), (0.0, 0.0, 1.0))
    assert camera.lens[0] == 0.1
    assert load_sensor('simulated').camera.distortion_model == 'equidistant'


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
        ('image: {width: 320, height: 240, crop: 320, crop_height: 241}', 'crop is 320x241'),
        ('image: {crop: 320, crop_height: 20}', 'crop_height is 20'),
        ('camera: {model: pinhole, distortion: [0.1]}', 'camera.distortion must hold 5 numbers'),
        ('camera: {model: pinhole, focal_px: [0.0, 300.0]}', 'focal_px must hold numbers above 0'),
        ('camera: {model: orthographic}', "'fisheye', 'pinhole'"),
        ('pattern: {diameter_mm: [0.2, 0.1]}', 'the least one first'),
        ('image: {with: 320}', "unknown parameter 'image.with'"),
        (
            'bins: {width_mm: 30.0, centre_mm: [2.0, 0.0]}',
            'reach 17 mm from the middle, but the gel ends at 16 mm',
        ),
        ('bins: {centre_mm: [0.0]}', 'bins.centre_mm must hold 2 numbers'),
        ('gel: {width_mm: 2500.0}', 'gel.width_mm has 2500 mm, but at most 500 is allowed'),
        ('gel: {moduli_mpa: [0.1, 100.0]}', 'gel.moduli_mpa holds 100, .* 100 kPa are 0.1'),
        ('gel: {sides: free, outline_mm: ellipse}', 'gel.sides is free, which only a flat rectangular gel can have'),
        ('gel: {sides: held, width_mm: 250.0}', 'gel.sides is held, .* at most 40 times as wide as thick'),
        ('gel: {sides: glued}', "'free', 'held'"),
        ('gel: {moduli_off: 3.0}', 'gel.moduli_off is 3, but must be at most 1: it is a share'),
        ('pattern: {kind: dots, pitch_mm: 40.0}', 'pattern.pitch_mm is 40, but the shorter side of the gel is 32 mm'),
        ('pattern: {kind: dots, diameter_mm: [3.0, 3.0]}', 'pattern.diameter_mm is 3, .*, 2 mm, would touch'),
        (
            'mask: {polygons_px: ["0,0 9,0 9,9", "700,0 900,0 900,480"]}',
            'polygon 2 of mask.polygons_px lies outside',
        ),
        (
            'camera: {focal_px_per_rad: 5000.0}',
            'camera.focal_px_per_rad and .* 6078x6078 pixels large, but the crop has 440x440',
        ),
        ('camera: {model: pinhole, focal_px: [30.0, 30.0]}', 'camera.focal_px and .* 42x42 pixels large'),
        ('# nothing yet', 'sensor.yaml is empty'),
    ],
)
def test_a_description_that_contradicts_itself_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(described(tmp_path, text))


def test_a_description_that_was_written_is_read_as_it_was(tmp_path: Path) -> None:
    sensor = replace(load_sensor('simulated'), name='a "name" # of \\ mine', mask=MaskSettings(('0,0 9,0 9,9',)))
    (tmp_path / 'mine.yaml').write_text(text_of(sensor, {'gel.width_mm': 'as given'}))
    assert load_sensor(tmp_path / 'mine.yaml') == sensor
    dots = load_sensor('printed_dots')
    (tmp_path / 'mine.yaml').write_text(text_of(dots, {}))
    assert load_sensor(tmp_path / 'mine.yaml') == dots


@pytest.mark.parametrize(
    'name', ['left 🖐', '𝔾el', 'Müller', 'two\u2028lines', 'odd\x7f\x85', 'x' * 90 + ' ' + 'y' * 90, '']
)
def test_any_letters_of_a_text_are_read_as_they_were_written(name: str, tmp_path: Path) -> None:
    """Signs beyond the first 65536 of Unicode were written as two halves, which YAML does not join."""
    sensor = replace(load_sensor('simulated'), name=name, mask=MaskSettings(('0,0 9,0 9,9',)))
    (tmp_path / 'mine.yaml').write_text(text_of(sensor, {'name': 'as given'}), encoding='utf-8')
    assert load_sensor(tmp_path / 'mine.yaml') == sensor


@pytest.mark.parametrize('name', sorted(each.stem for each in (share_directory() / 'config/sensors').glob('*.yaml')))
def test_every_sensor_that_ships_shows_its_gel_to_enough_regions(name: str) -> None:
    sensor = load_sensor(name)
    assert sensor.name == name
    assert usual_regions(sensor).usable.mean() > 0.5


def test_a_missing_sensor_is_reported_with_those_that_ship() -> None:
    with pytest.raises(ConfigurationError, match=r"no sensor 'other'.*simulated"):
        load_sensor('other')


@pytest.mark.parametrize('text', ['camera: {roll_deg: .inf}', 'camera: {tilt_deg: [0.0, .inf]}'])
def test_a_value_that_is_not_finite_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"sensor\.yaml.*(roll_deg'|tilt_deg) must be finite"):
        load_sensor(described(tmp_path, text))
