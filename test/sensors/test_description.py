"""A sensor's description: read whole, or refused in a sentence that names what contradicts what."""

from dataclasses import replace
from pathlib import Path

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensors import MaskSettings, load_sensor
from tactile_nodes.sensors.writing import text_of, values_of

DOME = (
    'gel: {width_mm: 16.0, height_mm: 16.0, outline_mm: ellipse, layers_mm: [4.0], moduli_mpa: [0.1], '
    'poisson_ratios: [0.49], markers_mm: [0.5, 1.5], dome_radius_mm: 25.0}'
)
"""Shallow: its rim is 1.31 mm lower than its middle."""


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
        ('gel: {markers_mm: [0.3, 0.3]}', 'the smaller one first'),
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
        (
            'camera: {model: pinhole, focal_px_per_rad: 500.0}',
            "focal_px_per_rad' has no effect with 'pinhole'",
        ),
        ('pattern: {pitch_mm: 2.0}', "pattern.pitch_mm' has no effect with 'spheres'"),
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
        ("gel: {outline_mm: '0,0 5,5'}", 'must be empty .a rectangle., ellipse, or three corners'),
        ('gel: {outline_mm: round}', 'must be empty'),
        ("gel: {outline_mm: '-20,-5 5,-5 5,5'}", 'goes beyond gel.width_mm by gel.height_mm, 32x32 mm'),
        ("gel: {outline_mm: '1,1 5,1 5,5'}", 'does not contain .0, 0.'),
        (f"gel: {{outline_mm: '{'0,0 1,0 1,1 ' * 200}'}}", '600 corners, at most 500'),
        (DOME.replace('25.0', '20.0'), 'a shallow dome has a radius of 22.9 mm or more'),
        (DOME.replace('[0.5, 1.5]', '[0.5, 2.7]'), '1.31 mm lower at its rim'),
        (DOME.replace('25.0', '-1.0'), 'at least 0.0'),
        ('frame: {position_mm: [1.0, 2.0]}', 'frame.position_mm must hold 3 numbers'),
        ('frame: {rpy_deg: [0.0, .inf, 0.0]}', r'sensor\.yaml:\d+: .*rpy_deg. must be finite'),
        ('frame: {id: left finger}', 'names of frames have no spaces'),
        ('frame: {parent: /hand}', 'no leading slash'),
        ("frame: {id: ''}", 'must be given and differ from'),
        ('frame: {id: hand, parent: hand}', 'must be given and differ from'),
        ('camera: {roll_deg: .inf}', r"sensor\.yaml.*roll_deg' must be finite"),
        ('camera: {tilt_deg: [0.0, .inf]}', r'sensor\.yaml:\d+: .*tilt_deg. must be finite'),
    ],
)
def test_a_description_that_contradicts_itself_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(described(tmp_path, text))


OUTLINE = '-6,-10 6,-10 12,0 6,10 -6,10 -12,0'
FRAME = 'frame: {id: left_finger, parent: gripper_link, position_mm: [0, 0, 12]}'


@pytest.mark.parametrize(
    'text',
    [
        r"""name: 'a "name" # of \ mine'""", 'mask: {polygons_px: ["0,0 9,0 9,9"]}', DOME, FRAME,
        'pattern: {kind: dots, pitch_mm: 2.5}', f"gel: {{outline_mm: '{OUTLINE}'}}",
    ],
)  # fmt: skip
def test_a_description_that_was_written_is_read_as_it_was(tmp_path: Path, text: str) -> None:
    sensor = load_sensor(described(tmp_path, text))
    assert sensor != load_sensor('simulated')
    (tmp_path / 'again.yaml').write_text(text_of(sensor, {'gel.width_mm': 'as given'}))
    assert load_sensor(tmp_path / 'again.yaml') == sensor


def test_the_card_of_a_flat_rectangular_gel_says_nothing_of_rim_dome_and_mounting(tmp_path: Path) -> None:
    values = values_of(load_sensor('simulated'))
    assert not [name for name in values if name.startswith(('gel.outline', 'gel.dome', 'frame'))]
    assert values_of(load_sensor(described(tmp_path, f"gel: {{outline_mm: '{OUTLINE}'}}")))['gel.outline_mm'] == OUTLINE
    assert not [name for name in values_of(load_sensor(described(tmp_path, FRAME))) if name.startswith('frame')]


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
