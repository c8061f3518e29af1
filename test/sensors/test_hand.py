"""Hand files: what they say of a hand, and what is left out of it with a sentence."""

from pathlib import Path

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensors import Hand, load_hand


def hand(tmp_path: Path, *sensors: str, head: str = '') -> Hand:
    file = tmp_path / 'hand.yaml'
    file.write_text(head + 'sensors:\n' + ''.join(f'  - {{{each}}}\n' for each in sensors))
    return load_hand(file)


def test_the_fingers_of_the_hand_that_ships_press_against_each_other() -> None:
    # Each z axis points out of its gel: that of the left to the right, -y, that of the right to the left.
    left, right = load_hand('two_fingers').sensors
    assert (left.name, right.name) == ('left', 'right')
    assert left.frame.parent_from_surface[:3, 2] == pytest.approx((0.0, -1.0, 0.0))
    assert right.frame.parent_from_surface[:3, 2] == pytest.approx((0.0, 1.0, 0.0))
    assert left.frame.parent_from_surface[:3, 3] == pytest.approx((0.0, 0.03, 0.08))


def test_a_sensor_is_called_by_its_name_and_fixed_to_the_frame_of_the_hand(tmp_path: Path) -> None:
    (thumb,) = hand(tmp_path, 'name: thumb', head='frame: palm\n').sensors
    assert (thumb.frame.id, thumb.frame.parent) == ('thumb', 'palm')


@pytest.mark.parametrize(
    ('one', 'other', 'doubted'),
    [
        ('', '', True),  # no poses
        (
            'position_mm: [0.0, 0.03, 0.08], rpy_deg: [1.57, 0.0, 0.0]',
            'position_mm: [0.0, -0.03, 0.08]',
            True,
        ),  # m, rad
        ('rpy_deg: [90.0, 0.0, 0.0]', 'rpy_deg: [-90.0, 0.0, 0.0]', False),  # fingers described as closed
        ('position_mm: [0.0, 30.0, 80.0]', 'position_mm: [0.0, -30.0, 80.0]', False),
    ],
)
def test_two_sensors_at_one_place_are_doubted(tmp_path: Path, one: str, other: str, doubted: bool) -> None:
    said = hand(tmp_path, f'name: a, frame: {{{one}}}', f'name: b, frame: {{{other}}}').doubted
    assert ("'a' and 'b' are at the same place and face the same way" in said) is doubted


@pytest.mark.parametrize(
    ('second', 'said'),
    [
        ('name: a', "hand.yaml:3: there are two sensors with the name 'a'"),
        ('name: b, source: /dev/video7', "'b' uses the camera /dev/video7, which 'a' already uses"),
        ("name: b, source: '7'", "'b' uses the camera 7, which 'a' already uses"),
        ('name: b, frame: {position_mm: [1.0, 2.0]}', 'frame.position_mm must hold 3 numbers'),
        ('name: b, frame: {rpy_deg: [0.0, .inf, 0.0]}', "'frame.rpy_deg' must be finite"),
        ('name: b, frame: {rpy_deg: [0.0, .nan, 0.0]}', "'frame.rpy_deg' must be a number, got nan"),
        ('name: b, frame: {parent: arm}', "'b' is mounted in 'arm'"),
        ('name: b, frame: {id: a}', "have the same frame.id 'a'"),
        ('name: a_camera_optical_frame', "have the same frame 'a_camera_optical_frame'"),
        ('name: b, frame: {id: hand}', "frame.id is 'hand', but must be given and differ from"),
        ('name: b, soruce: simulated', "hand.yaml:3: unknown parameter 'soruce'"),
        ('name: my-finger', 'needs a name of letters, digits and underscores'),
        ('name: b, frame: {position_mm: [0, 1.5, 0]}', 'a list holds one type: write 0.0 for 0'),
        ("name: b, source: ''", "hand.yaml:3: the source of 'b' is empty; name a camera or a recording"),
        ('source: simulated', 'needs a name of letters, digits and underscores'),
    ],
)
def test_a_sensor_that_cannot_be_used_is_left_out_with_a_sentence(tmp_path: Path, second: str, said: str) -> None:
    found = hand(tmp_path, 'name: a, source: /dev/video7', second, 'name: c')
    assert found.names == ('a', 'c')
    (refused,) = found.refused
    assert said in refused


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('frame: hand\n', "must hold a list 'sensors'"),
        ('sensors: []\n', "must hold a list 'sensors'"),
        ('sensors: [left]\n', "none of its sensors can be used: .*each of 'sensors' maps names to values"),
        ('frame: hand\nfrictoin: 0.5\nsensors: [{name: a}]\n', "hand.yaml:2: unknown parameter 'frictoin'"),
        ('frame: a\nframe: b\nsensors: [{name: a}]\n', "hand.yaml:2: 'frame' is given twice"),
        ('sensors: [{name: a}]\nsensors: [{name: b}]\n', "hand.yaml:2: 'sensors' is given twice"),
        ('sensors:\n- {name: z, frame: {rpy_deg: [0.0], rpy_deg: [1.0]}}\n', "hand.yaml:2: 'rpy_deg' is given twice"),
        ('frame: z_camera_optical_frame\nsensors: [{name: z}]\n', 'which is the frame of the hand; rename one'),
        ('friction: -1.0\nsensors: [{name: a}]\n', "'friction' must be"),
        ('sensors: [{name: 7up}]\n', 'none of its sensors can be used'),
        ('sensors: [\n', 'not valid YAML'),
    ],
)
def test_what_is_no_hand_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / 'hand.yaml').write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        load_hand(tmp_path / 'hand.yaml')


def test_a_hand_that_is_not_there_is_reported_beside_those_that_ship() -> None:
    with pytest.raises(ConfigurationError, match=r"there is no hand 'three'.*: gripping_fingers, two_fingers"):
        load_hand('three')
