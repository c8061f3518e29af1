"""``tactile press``: a simulated hand is guided, and what a person at the terminal answers."""

from __future__ import annotations

import codecs
import math
import os
import shlex
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from coarse_table import linear_table
from jumping_clock import JumpingClock

from tactile_nodes.cli.main import main
from tactile_nodes.cli.press import TerminalPerson, next_steps, read_answer
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.drivers.camera.contract import CameraSettings, SceneSettings
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.errors import DatasetError, DeviceError
from tactile_nodes.learning.datasets.file import load_dataset
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.guided.drawing import marked, sketch
from tactile_nodes.learning.guided.folder import PressFolder
from tactile_nodes.learning.guided.guide import NO_PLACE, RESTS, UNUSABLE, Guide
from tactile_nodes.learning.guided.simulated import AWAY, SimulatedPerson
from tactile_nodes.learning.guided.targets import Target, Wish
from tactile_nodes.learning.guided.watching import HELD, MOVING, STEADY, UNTOUCHED, Watch
from tactile_nodes.learning.tables.presses import read_table
from tactile_nodes.model_file import load_model
from tactile_nodes.sensors import PatternDescription, Sensor, load_sensor
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

REACH = (16.0, 16.0)
SIDES = (32.0, 32.0)
NEWTON_PER_GRAM = 9.81e-3


class Aside(SimulatedPerson):
    """Presses 10 mm to the right of the mark, and says so only when asked again."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(Sensor(), NEWTON_PER_GRAM, lines.append, world='aside')
        self.places = [(0.0, 0.0), (10.0, 0.0)]

    def press(self, target: Target, picture: np.ndarray, done: list[Target]) -> None:
        super().press(Target(10.0, 0.0, target.force_n), picture, done)

    def say(self, text: str) -> None:
        if 'type the place' not in text:
            self._now = AWAY
        self._tell(text)

    def reading(self, target: Target) -> tuple[float, tuple[float, float]] | None:
        return 30.0, self.places.pop(0)


class Unsteady(SimulatedPerson):
    """Presses as asked, but lifts while the scale is read, passes one press over, and stops after four."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(Sensor(), NEWTON_PER_GRAM, lines.append, world='unsteady')
        self.asked: list[Target] = []

    def reading(self, target: Target) -> tuple[float, tuple[float, float]] | None:
        self.asked.append(target)
        readings, answer = len(self.asked), super().reading(target)
        if readings == 2:
            self._now = Press(target.x_mm, target.y_mm, 0.7 * self._now.depth_mm)
        if readings == 4:
            raise KeyboardInterrupt
        assert answer is not None
        return None if readings == 3 else answer


def folder_of(path: Path, unit: str = 'g') -> PressFolder:
    return PressFolder(path, unit, 'ball:0.6', REACH)


def test_what_a_hand_presses_becomes_a_data_set_and_goes_on_where_it_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('tactile_nodes.clock.SystemClock', JumpingClock)
    words = ['press', str(tmp_path / 'by_hand'), '--indenter', 'ball:0.6', '--forces', '20', '60', '--presses']
    assert main([*words, '2']) == 0
    printed = capsys.readouterr().out
    assert '2 of 2 presses (1 of about 20 g, 1 of about 60 g)' in printed
    assert printed.endswith('too few presses (2): a calibration needs at least 5. Continue with --presses 30\n')
    assert main([*words, '5']) == 0
    assert 'enough presses. Next steps:' in capsys.readouterr().out
    table = tmp_path / 'by_hand' / 'presses.csv'
    rows = read_table(table).rows
    assert [row.touches for row in rows] == [False] * RESTS + [False, True] * 5
    assert main(['dataset', 'import', str(table), '-o', str(tmp_path / 'presses.npz')]) == 0
    assert f'has the image of line {RESTS + 1} again' not in capsys.readouterr().out  # the last one at the beginning
    presses = load_dataset(tmp_path / 'presses.npz')
    assert presses.card['indenters'] == ['ball:0.6'] and presses.contact.sum() == 5


def test_what_is_printed_at_the_end_calibrates_a_described_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('tactile_nodes.clock.SystemClock', JumpingClock)
    words = ['press', str(tmp_path / 'by hand'), '--sensor', 'printed_dots', '--indenter', 'ball:5', '--presses', '6']
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert 'under ball:5 the gel responds linearly up to about 150 g' in printed
    commands = [shlex.split(line)[1:] for line in printed.splitlines() if line.startswith('  tactile ')]
    assert [each[0] for each in commands] == ['calibrate', 'calibrate', 'dataset']
    for command in commands:
        assert main(command) == 0, command
    loaded = load_model(tmp_path / 'by hand' / 'calibrated.safetensors')
    assert (loaded.gel, loaded.card['body']) == ('by hand', 'ball:5')
    assert load_dataset(tmp_path / 'by hand' / 'presses.npz').contact.sum() == 6


def test_an_indenter_of_no_known_shape_is_asked_for_where_it_is_needed() -> None:
    steps = next_steps(Path('a/presses.csv'), 'mine.yaml', known=False)
    assert steps[1][6:8] == ['--body', 'BODY']


def test_a_simulated_hand_presses_with_what_is_named() -> None:
    person = SimulatedPerson(load_sensor('printed_dots'), NEWTON_PER_GRAM, [].append, body=KnownBody.named('ball:5'))
    person.press(Target(0.0, 0.0, 0.5), np.zeros((1, 1), np.uint8), [])
    # The paper's tip goes 1.2 mm deep with 0.5 N, Hertz's ball of 5 mm on a half-space of 0.1 MPa 0.56, and less here.
    assert 0.3 < person.press_at(0).depth_mm < 0.56


def test_a_simulated_hand_says_what_it_cannot_press_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['press', str(tmp_path / 'none'), '--indenter', 'ring']) == 1
    assert 'a simulated hand presses with a ball or a punch' in capsys.readouterr().err


def test_a_simulated_hand_presses_harder_while_nothing_is_seen() -> None:
    person = SimulatedPerson(Sensor(), NEWTON_PER_GRAM, [].append, world='harder')
    person.press(Target(0.0, 0.0, 0.01), np.zeros((1, 1), np.uint8), [])
    before = person.force_at(0)
    person.sees(UNTOUCHED, NO_PLACE)
    assert person.force_at(0) > before
    person.leave_untouched()
    person.sees(UNTOUCHED, NO_PLACE)
    assert person.force_at(0) == 0


def test_a_press_that_moves_while_it_is_read_is_not_kept_and_ctrl_c_loses_none(tmp_path: Path) -> None:
    lines: list[str] = []
    person = Unsteady(lines)
    settings = CameraSettings(scene=SceneSettings(world='unsteady'))
    camera = open_camera(settings, JumpingClock())
    guide = Guide(camera, person, folder_of(tmp_path), Wish(9, (0.3, 0.5), Sensor()), Sensor())
    with pytest.raises(KeyboardInterrupt):
        guide.run()
    assert any('the press moved while you read the scale' in line for line in lines)
    assert 'passed over' in lines
    _, moved, skipped, after = person.asked
    assert moved == skipped  # what was not kept is asked for again, what is skipped is not
    assert after[:2] != skipped[:2] and after.force_n == skipped.force_n
    (done,) = folder_of(tmp_path).done  # of four the first
    assert done.force_n == pytest.approx(0.3, rel=0.2)
    assert person.press_at(0) != AWAY


@pytest.mark.parametrize(
    ('place_mm', 'grams', 'refusal'),
    [
        ((99.0, 0.0), 50.0, 'x is read as 99 mm'),
        (NO_PLACE, 5e5, 'the reading is read as 4905 N: forces must be below 200 N'),
    ],
)
def test_an_answer_that_no_press_can_be_is_asked_again_and_never_written(
    place_mm: tuple[float, float], grams: float, refusal: str, tmp_path: Path
) -> None:
    assert folder_of(tmp_path).fault(grams, place_mm).startswith(refusal)
    assert folder_of(tmp_path).fault(50.0, (1.0, 2.0)) == ''


def test_a_name_of_an_indenter_that_would_break_the_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match='holds a comma'):
        PressFolder(tmp_path, 'g', 'ball, steel', REACH)


def test_a_picture_is_on_the_disk_before_its_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the table may name an empty picture after a cut of power, and the press is lost."""
    synced: list[str] = []
    monkeypatch.setattr(os, 'fsync', lambda end: synced.append(Path(f'/proc/self/fd/{end}').readlink().name))
    folder_of(tmp_path).add_rest(np.zeros((20, 20), np.uint8))
    assert synced == ['rest_0001.png', 'presses.csv']


def test_a_press_beside_its_mark_is_asked_for_its_place(tmp_path: Path) -> None:
    lines: list[str] = []
    person = Aside(lines)
    camera = open_camera(CameraSettings(scene=SceneSettings(world='aside')), JumpingClock())
    Guide(camera, person, folder_of(tmp_path), Wish(1, (0.3,), Sensor()), Sensor()).run()
    assert any('mm away: type the place' in line for line in lines)
    assert folder_of(tmp_path).done[0][:2] == (10.0, 0.0)


def test_a_folder_of_another_gel_is_not_gone_on_with(tmp_path: Path) -> None:
    person = SimulatedPerson(Sensor(), NEWTON_PER_GRAM, [].append, world='another')
    other = Gel(seed=77)
    folder = folder_of(tmp_path)
    folder.add_rest(Optics(other, contact_table(other)).render((), 1))
    camera = open_camera(CameraSettings(scene=SceneSettings(world='another')), JumpingClock())
    with pytest.raises(DatasetError, match=r'untouched images .* it sees another gel, .* start another folder'):
        Guide(camera, person, folder, Wish(2, (0.3,), Sensor()), Sensor()).run()
    assert len(folder_of(tmp_path).rows) == 1


@pytest.mark.parametrize('name', ['simulated', 'printed_dots', 'speckle_membrane'])
def test_the_lightest_press_that_is_asked_for_is_seen_and_so_is_letting_go(name: str) -> None:
    gel = gel_of(load_sensor(name))
    table = contact_table(gel)
    optics = Optics(gel, table)
    watch = Watch(load_sensor(name), [optics.render((), each) for each in range(RESTS)])
    held = (Press(0.0, 0.0, table.depth_at(0.85 * 20 * NEWTON_PER_GRAM)),)
    assert [watch.see(optics.render(held, 100 + each)) for each in range(HELD)] == [MOVING] * (HELD - 1) + [STEADY]
    assert [watch.see(optics.render((), 200 + each)) for each in range(HELD)] == [UNTOUCHED] * HELD


def test_a_press_between_printed_dots_is_seen_where_it_is() -> None:
    """By texture, which they lack, most presses on dots 55 px apart in 640x480 pictures were seen 5 to 13 mm away."""
    membrane = load_sensor('speckle_membrane')
    dots = PatternDescription('dots', pitch_mm=2.7, diameter_mm=(1.0, 1.0), dark=True, dot_mm=(0.4, -0.6))
    sensor = replace(membrane, pattern=dots)
    optics = Optics(gel_of(sensor), contact_table(gel_of(sensor)))
    watch = Watch(sensor, [optics.render((), each) for each in range(RESTS)])
    for place_mm in ((-10.0, -3.5), (8.0, 4.0)):
        watch.see(optics.render((Press(*place_mm, 0.8),), 100))
        assert math.dist(watch.place_mm, place_mm) < 2


def test_a_press_is_held_still_though_the_picture_flickers_where_it_shows_the_rim_of_the_gel() -> None:
    """A ball near a corner did that by itself: regions with half of their markers beyond it moved by a pixel."""
    straight = load_sensor('speckle_membrane')
    camera = replace(straight.camera, position_mm=(0.6, -0.8, -20.0), tilt_deg=(1.0, -1.5), roll_deg=2.0)
    sensor = replace(straight, camera=camera)
    optics = Optics(gel_of(sensor), contact_table(gel_of(sensor)))

    def seen(presses: tuple[Press, ...], number: int, flicker_px: int) -> np.ndarray:
        picture = optics.render(presses, number).copy()
        picture[4:36, 80:176] = np.roll(picture[4:36, 80:176], flicker_px, axis=1)
        return picture

    watch = Watch(sensor, [seen((), each, 0) for each in range(RESTS)])
    states = [watch.see(seen((Press(0.0, 0.0, 0.6),), 100 + each, each % 3 - 1)) for each in range(2 * HELD)]
    assert states[HELD - 1 :] == [STEADY] * (HELD + 1)


def recorded(folder: Path, pictures: Iterable[np.ndarray]) -> None:
    folder.mkdir(exist_ok=True)
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f'{number:02}.png'), picture)


def after_a_move(folder: Path, shift_mm: float, rests: int, pictures: int) -> None:
    """The rest images of a session, and what the camera sees later, when it has moved."""
    gel = replace(Gel(), mechanics='linear')
    table = linear_table(gel)
    for number in range(rests):
        folder_of(folder / 'out').add_rest(Optics(gel, table).render((), number))
    moved = Optics(replace(gel, camera_shift_mm=(shift_mm, 0.0)), table)
    recorded(folder / 'pictures', (moved.render((), 100 + number) for number in range(pictures)))


def guided_by_recording(folder: Path, lines: list[str] | None = None) -> None:
    camera = open_camera(CameraSettings(source=str(folder / 'pictures'), rate=0.0), JumpingClock())
    person = SimulatedPerson(Sensor(), NEWTON_PER_GRAM, [].append if lines is None else lines.append, world='none')
    Guide(camera, person, folder_of(folder / 'out'), Wish(2, (0.3,), Sensor()), Sensor()).run()


def test_a_recording_that_ends_is_reported(tmp_path: Path) -> None:
    recorded(tmp_path / 'pictures', [Optics(Gel(), contact_table(Gel())).render((), 1)])
    with pytest.raises(DeviceError, match='the recording has ended'):
        guided_by_recording(tmp_path)


def test_a_camera_that_moved_a_little_since_the_last_session_shows_no_press(tmp_path: Path) -> None:
    """By 0.015 mm, a third of a pixel, as overnight: with the rest images of the first day all of the gel moves."""
    after_a_move(tmp_path, 0.015, rests=RESTS, pictures=30)
    lines: list[str] = []
    with pytest.raises(DeviceError, match='the recording has ended'):
        guided_by_recording(tmp_path, lines)
    assert len(folder_of(tmp_path / 'out').rows) == RESTS
    assert lines == ['pressing at x 0, y 0 mm']


def test_a_camera_that_was_moved_since_the_last_session_is_refused(tmp_path: Path) -> None:
    """By 0.2 mm, three pixels: each press would be measured against another part of the pattern."""
    after_a_move(tmp_path, 0.2, rests=1, pictures=12)
    with pytest.raises(DatasetError, match=r'the camera has moved by 2\.\d px, .* start another folder'):
        guided_by_recording(tmp_path)


def test_a_gel_is_untouched_though_the_camera_drifts_and_a_press_is_still_seen() -> None:
    """By 0.06 px in 150 images, twice what counts as a touch if it comes at once."""
    gel = replace(Gel(), mechanics='linear')
    table = linear_table(gel)

    def seen(number: int, presses: tuple[Press, ...] = ()) -> np.ndarray:
        drifted = replace(gel, camera_shift_mm=(0.004 * min(number / 150, 1.0), 0.0))
        return Optics(drifted, table).render(presses, number)

    watch = Watch(Sensor(), [seen(0) for _ in range(RESTS)])
    assert {watch.see(seen(number)) for number in range(150)} == {UNTOUCHED}
    press = (Press(0.0, 0.0, table.depth_at(20 * NEWTON_PER_GRAM)),)
    assert [watch.see(seen(150 + number, press)) for number in range(HELD)][-1] == STEADY


def test_dark_pictures_with_which_a_camera_begins_are_passed_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As with a GelSight Mini, whose first ten pictures are dark. A recording has no press, and then ends."""
    gel = replace(gel_of(load_sensor('printed_dots')), mechanics='linear')
    optics = Optics(gel, linear_table(gel))
    dark = [np.zeros((240, 320), np.uint8)] * 10
    recorded(tmp_path / 'pictures', dark + [optics.render((), number) for number in range(10, 40)])
    words = ['press', str(tmp_path / 'by_hand'), '--source', str(tmp_path / 'pictures'), '--sensor', 'printed_dots']
    assert main([*words, '--indenter', 'ball:5']) == 1
    assert 'the recording has ended' in capsys.readouterr().err
    assert len(read_table(tmp_path / 'by_hand' / 'presses.csv').rows) == RESTS


def test_a_camera_that_stays_dark_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path, [np.zeros((240, 320), np.uint8)] * UNUSABLE)
    words = ['press', str(tmp_path / 'by_hand'), '--source', str(tmp_path), '--sensor', 'printed_dots']
    assert main([*words, '--indenter', 'ball:5']) == 1
    assert 'the camera image is black' in capsys.readouterr().err


def test_another_unit_than_the_folder_has_is_refused(tmp_path: Path) -> None:
    folder_of(tmp_path).add_rest(np.full((480, 640), 90, np.uint8))
    with pytest.raises(DatasetError, match='does not begin with picture,x_mm,y_mm,force_n,indenter'):
        folder_of(tmp_path, 'N')


def test_a_table_whose_separators_were_changed_is_refused_with_what_it_had(tmp_path: Path) -> None:
    folder_of(tmp_path).add_press(np.zeros((64, 64), np.uint8), (1.5, 2.0), 20.0)
    table = tmp_path / 'presses.csv'
    table.write_text(table.read_text().replace(',', ';').replace('1.5', '1,5'))
    with pytest.raises(DatasetError, match='use the unit and the commas that it had, or another folder'):
        folder_of(tmp_path)


def test_a_table_that_a_spreadsheet_has_saved_is_gone_on_with(tmp_path: Path) -> None:
    """A wrong weight was corrected; Excel adds a byte order mark, and ends lines as Windows does."""
    folder_of(tmp_path).add_press(np.zeros((64, 64), np.uint8), (1.0, 2.0), 20.0)
    table = tmp_path / 'presses.csv'
    table.write_bytes(codecs.BOM_UTF8 + table.read_bytes().replace(b',20,', b',25,').replace(b'\n', b'\r\n'))
    folder = folder_of(tmp_path)
    folder.add_press(np.ones((64, 64), np.uint8), (3.0, 4.0), 50.0)
    assert [row.force_n for row in folder.rows] == pytest.approx([25 * NEWTON_PER_GRAM, 50 * NEWTON_PER_GRAM])


def test_what_a_terminal_shows_begins_on_a_line_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(['x', '50'])

    def answer(question: str) -> str:
        print(question)
        return next(answers)

    monkeypatch.setattr('builtins.input', answer)
    person, target = TerminalPerson(tmp_path, Sensor(), 'g', NEWTON_PER_GRAM), Target(0.0, 0.0, 0.2)
    person.sees('moving', (-0.3, 2.6))
    assert person.reading(target) == (50.0, (0.0, 0.0))
    person.say('kept')
    person.sees('untouched', (0.0, 0.0))
    person.press(target, np.zeros((480, 640), np.uint8), [])
    lines = [line.strip() for line in capsys.readouterr().out.split('\n')]
    assert lines[0] == 'moving, about x 0, y 3 mm'
    assert lines[1].startswith('steady. Keep holding.') and lines[3:5] == ['kept', 'untouched']
    assert set(lines[5]) == {'.'}


def test_a_force_in_millinewtons_is_asked_for_in_digits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    person = TerminalPerson(tmp_path, Sensor(), 'mN', 1e-3)
    person.press(Target(0.0, 0.0, 1.2753), np.zeros((480, 640), np.uint8), [])
    assert 'with about 1280 mN, and hold' in capsys.readouterr().out


def test_a_mark_in_the_picture_is_where_the_description_says() -> None:
    # The pupil is 23 mm below the middle of the gel, so that this is seen in the middle of the picture.
    drawn = marked(np.zeros((480, 640), np.uint8), Sensor(), Target(0.0, 0.0, 0.2), [Target(-5.0, 0.0, 0.2)])
    red = np.argwhere((drawn == (0, 0, 255)).all(axis=2)).mean(axis=0)
    green = np.argwhere((drawn == (0, 200, 0)).all(axis=2)).mean(axis=0)
    assert red == pytest.approx([239.5, 319.5], abs=1.0)
    assert green[0] == pytest.approx(239.5, abs=1.0) and 240 < green[1] < 270


def test_a_sketch_has_y_downwards_as_the_picture_has() -> None:
    lines = sketch(SIDES, Target(-16.0, 16.0, 0.2), [Target(16.0, -16.0, 0.2)])
    assert lines[-1].startswith('X') and lines[0].endswith('o')


@pytest.mark.parametrize(
    ('text', 'answer'),
    [
        ('50', (50.0, (3.0, -2.0))),
        ('50,5', (50.5, (3.0, -2.0))),
        ('50 3.5 -2', (50.0, (3.5, -2.0))),
        ('s', None),
        ('', 'enter the reading alone, e.g. 50, or with a position, e.g. 50 3.5 -2'),
        ('50 3', 'enter the reading alone, e.g. 50, or with a position, e.g. 50 3.5 -2'),
        ('fifty', 'enter the reading alone, e.g. 50, or with a position, e.g. 50 3.5 -2'),
        ('0', 'the reading must be above 0; tare the scale with the sensor on it'),
    ],
)
def test_answers_at_the_terminal(text: str, answer: object) -> None:
    assert read_answer(text, (3.0, -2.0)) == answer
