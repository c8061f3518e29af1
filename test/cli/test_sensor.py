"""`tactile sensor`, as a person runs it."""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.cli.main import main
from tactile_nodes.cli.sensor.questions import depths, modulus
from tactile_nodes.clock import Clock
from tactile_nodes.drivers.camera import opening
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings
from tactile_nodes.sensors import load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics

Typed = Callable[[str], io.TextIOWrapper]
CALIBRATION = """\
image_width: 320
image_height: 240
camera_matrix: {rows: 3, cols: 3, data: [340.0, 0.0, 159.5, 0.0, 341.0, 119.5, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.05, 0.01, 0.0, 0.0, 0.0]}
"""


@pytest.fixture(scope='module')
def pictures() -> list[np.ndarray]:
    """The sensor with printed dots at rest; a cable hides the left of it."""
    gel = replace(gel_of(load_sensor('printed_dots')), mechanics='linear')
    optics = Optics(gel, linear_table(gel))
    shown = [optics.render((), number) for number in range(3)]
    for each in shown:
        each[:, :50] = 4
    return shown


@pytest.fixture
def folder(tmp_path: Path, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / 'rest').mkdir()
    for number, each in enumerate(pictures):
        cv2.imwrite(str(tmp_path / 'rest' / f'{number}.png'), each)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Typed:
    """What a person types at a terminal whose encoding lacks umlauts."""

    def type_in(text: str) -> io.TextIOWrapper:
        terminal = io.TextIOWrapper(io.BytesIO(text.encode()), encoding='ascii')
        terminal.isatty = lambda: True  # type: ignore[method-assign]
        monkeypatch.setattr('sys.stdin', terminal)
        return terminal

    return type_in


def test_pictures_become_a_description_that_they_fit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml', '--width', '18.5', '--stiffness', '10A', '--yes']) == 0
    shown = capsys.readouterr().out
    assert 'dark dots, 16.8 px wide' in shown  # 1 mm, of which each is 17.3 px
    sensor, text = load_sensor('mine.yaml'), (folder / 'mine.yaml').read_text()
    assert sensor.name == 'mine'
    assert sensor.pattern.pitch_mm == pytest.approx(2.5, rel=0.03)
    assert sensor.gel.moduli_mpa == pytest.approx((0.1376,), abs=1e-4)
    assert sensor.covered[:, :48].all()
    assert not sensor.covered[:, 56:].any()
    assert 'moduli_mpa: [0.137561]  # as given' in text
    assert 'layers_mm: [4.0]  # assumed' in text
    assert re.search(r'dot_mm: .*  # found in the picture', text)
    assert sensor.gel.moduli_off == 0.3
    assert cv2.imread('mine.png').shape[1] == 960
    assert main(['sensor', 'check', 'mine.yaml', 'rest']) == 0
    assert capsys.readouterr().out.count('ok   ') == 11
    assert Path('mine_check.png').is_file()


def test_of_a_gel_of_unknown_stiffness_forces_are_known_to_90_percent_and_the_next_command_can_be_typed_as_printed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['sensor', 'new', 'rest', '-o', 'my sensor.yaml', '--width', '18.5', '--yes']) == 0
    printed = capsys.readouterr().out.rsplit('with: ', 1)[1]
    assert shlex.split(printed)[:4] == ['tactile', 'calibrate', '--sensor', 'my sensor.yaml']
    assert load_sensor('my sensor.yaml').gel.moduli_off == 0.9


def test_a_calibration_of_the_camera_is_written_into_it(folder: Path) -> None:
    (folder / 'ost.yaml').write_text(CALIBRATION)
    words = ['sensor', 'new', 'rest/0.png', '-o', 'mine.yaml', '--pitch', '2.5', '--camera-info', 'ost.yaml', '--yes']
    assert main(words) == 0
    (folder / 'ost.yaml').unlink()
    camera = load_sensor('mine.yaml').camera
    assert camera.focal_px == (340.0, 341.0)
    assert camera.distortion == (-0.05, 0.01, 0, 0, 0)
    assert camera.position_mm[2] == pytest.approx(-20, abs=0.2)


def test_a_camera_of_ones_own_may_have_a_source_that_ends_like_a_picture(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As docs/extending.md adds one: `still:FILE` in `opening.py`."""
    of_package = opening._camera

    def with_ours(settings: CameraSettings, clock: Clock, tell: Callable[[str], None] | None) -> Camera:
        folder = settings.source.removeprefix('still:').rpartition('/')[0]
        return of_package(replace(settings, source=folder), clock, tell)

    monkeypatch.setattr(opening, '_camera', with_ours)
    words = ['sensor', 'new', 'still:rest/0.png', '-o', 'mine.yaml', '--frames', '3', '--pitch', '2.5', '--yes']
    assert main(words) == 0


def test_a_calibrated_camera_at_a_known_distance_shows_the_width(folder: Path, typed: Typed) -> None:
    """Dots 2.5 mm apart are 43.2 px apart, so they are 19.7 mm away at 340 px of focal length."""
    (folder / 'ost.yaml').write_text(CALIBRATION)
    typed('\n\n\n')
    words = ['sensor', 'new', 'rest/0.png', '-o', 'mine.yaml', '--camera-info', 'ost.yaml', '--distance', '20']
    assert main(words) == 0
    sensor, text = load_sensor('mine.yaml'), Path('mine.yaml').read_text()
    assert sensor.camera.position_mm[2] == -20
    assert sensor.pattern.pitch_mm == pytest.approx(2.5, rel=0.01)
    assert re.search(r'width_mm: .*  # from the picture and the distance given', text)


def test_a_gel_that_ends_within_the_picture_has_sides_that_are_asked_for(
    folder: Path, pictures: list[np.ndarray], typed: Typed
) -> None:
    """Its left and right are covered; a wrong answer is asked for again."""
    for number, each in enumerate(pictures):
        framed = each.copy()
        framed[:, -50:] = 4
        cv2.imwrite(str(folder / 'rest' / f'{number}.png'), framed)
    terminal = typed('2.5\n4\n0.1\nglued\nfree\n0.3\n20\n')
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml']) == 0
    assert load_sensor('mine.yaml').gel.sides == 'free'
    assert not terminal.read()


def test_sides_can_be_given(folder: Path) -> None:
    words = ['--width', '18.5', '--yes', '--sides', 'held']
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml', *words]) == 0
    assert load_sensor('mine.yaml').gel.sides == 'held'
    with pytest.raises(SystemExit):
        main(['sensor', 'new', 'rest', '-o', 'other.yaml', *words[:-1], 'glued'])


def test_a_person_is_asked_until_the_answer_can_be_read(
    folder: Path, capsys: pytest.CaptureFixture[str], typed: Typed
) -> None:
    typed('\n18.5\nweiß nicht\n4\n0.12\n0.6-0.3\n0.3\n\n')
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml']) == 0
    sensor = load_sensor('mine.yaml')
    assert sensor.gel.layers_mm == (4.0,)
    assert sensor.gel.moduli_mpa == (0.12,)
    assert sensor.gel.markers_mm == (0.3, 0.4)
    assert sensor.camera.position_mm[2] == -20.0
    printed = capsys.readouterr().out
    assert r"'wei\\xc3\\x9f nicht' is not a number above 0" in printed
    assert "'0.6-0.3' is not in order" in printed


def test_of_dots_their_pitch_is_asked_for_first(folder: Path, capsys: pytest.CaptureFixture[str], typed: Typed) -> None:
    """43.2 px are 2.5 mm, and the dots 19.65 mm away: 340 px of focal length, as the simulated camera has."""
    typed('2.5\n\n\n\n\n')
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml']) == 0
    assert load_sensor('mine.yaml').pattern.pitch_mm == 2.5
    assert load_sensor('mine.yaml').camera.focal_px[0] == pytest.approx(340, rel=0.01)
    assert 'the pitch given' in Path('mine.yaml').read_text()
    assert 'How wide is the whole picture' not in capsys.readouterr().out


def test_questions_that_end_early_name_the_flag(folder: Path, capsys: pytest.CaptureFixture[str], typed: Typed) -> None:
    typed('2.5\n')
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml']) == 1
    assert 'answer with --thickness' in capsys.readouterr().err
    assert not Path('mine.yaml').exists()


@pytest.mark.parametrize(
    ('words', 'refusal'),
    [
        (['rest'], 'No picture shows this; give it with --width, or of dots --pitch, or --camera-info and'),
        (['rest', 'other.png', '--width', '18'], 'other.png has 640x480 pixels, but picture 0 of rest has 320x240'),
        (['flat.png', '--width', '18'], 'mine.yaml was not written: fix the findings marked bad first'),
        (['black.png', '--width', '18'], 'the camera image is black'),
        (['rest', '--width', '18', '--mask', 'black.png'], 'the mask covers the whole image'),
        (['rest', '--width', '18', '--mask', 'other.png'], 'has 640x480 pixels, but image says 320x240'),
        (['rest', '--width', '18', '--camera-info', 'ost.yaml'], 'was calibrated with pictures of 640x240'),
        (['rest', '--width', '18', '--crop', '400x200'], 'cannot cut 400x200 pixels from an image of 320x240'),
        (['rest', '--width', '18', '--skip', '9'], 'ends before picture 9'),
        (['rest/0.png', '--pitch', '2.5', '--fisheye'], '--fisheye is the lens model of a calibration'),
        (['none.png', '--width', '18'], "no camera, video or folder of images is named 'none.png'"),
        (['rest', '--pitch', '2.5', '--distance', '0.2'], 'the answers contradict each other: camera.focal_px'),
    ],
)
def test_what_no_description_follows_from_is_refused_and_nothing_written(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], refusal: str
) -> None:
    for name, picture in (
        ('other', np.full((480, 640), 99)), ('flat', np.full((240, 320), 90)), ('black', np.zeros((240, 320))),
    ):  # fmt: skip
        cv2.imwrite(f'{name}.png', picture.astype(np.uint8))
    (folder / 'ost.yaml').write_text(CALIBRATION.replace('320', '640', 1))
    assert main(['sensor', 'new', *words, '-o', 'mine.yaml', '--yes']) == 1
    assert refusal in capsys.readouterr().err
    assert not Path('mine.yaml').exists()


@pytest.mark.parametrize('name', ['mine.yaml', 'mine.png'])
def test_a_description_or_picture_that_is_there_is_kept(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(name).write_text('name: precious\n')
    assert main(['sensor', 'new', 'rest', '-o', 'mine.yaml', '--width', '18', '--yes']) == 1
    assert f'{name} exists; choose another name, or replace it with --force' in capsys.readouterr().err
    assert Path(name).read_text() == 'name: precious\n'


def test_a_description_is_not_written_over_its_figure(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['sensor', 'new', 'rest', '-o', 'mine.png', '--width', '18', '--yes']) == 1
    assert 'mine.png is the name of the figure' in capsys.readouterr().err
    assert not Path('mine.png').exists()


@pytest.mark.parametrize(
    ('words', 'read'),
    [
        (['-o', 'mine.yaml', '--mask', 'mine.png', '--force'], 'mine.png'),
        (['-o', 'rest/0.yaml'], '.png: rest'),
    ],
    ids=['the mask', 'of the folder'],
)
def test_no_picture_that_is_read_is_drawn_over(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], read: str
) -> None:
    Path('mine.png').write_bytes(Path('rest/0.png').read_bytes())
    before = {each: each.read_bytes() for each in Path().rglob('*.png')}
    assert main(['sensor', 'new', 'rest', '--width', '18', '--yes', *words]) == 1
    assert f'{read} is read for it; choose another file' in capsys.readouterr().err
    assert {each: each.read_bytes() for each in Path().rglob('*.png')} == before


def test_dots_that_are_not_there_are_bad(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite('flat.png', np.full((240, 320), 90, np.uint8))
    assert main(['sensor', 'check', 'printed_dots', 'flat.png']) == 1
    assert 'bad  dots: no dots in rows and columns; 35 are described' in capsys.readouterr().out


def test_answers_are_read_as_a_person_means_them() -> None:
    """Gent (1958): Shore A 10 is 0.413 MPa of Young's modulus, a third of that of shear."""
    assert modulus('10A') == pytest.approx(0.413 / 3, abs=1e-3)
    assert modulus('0.1') == 0.1
    assert depths('0.3') == (0.3, 0.4)
    assert depths('1.5-6') == (1.5, 6.0)
