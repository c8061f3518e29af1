"""A calibration that grows with the presses: what each is read as, when more do not pay, and what is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from press_bags import OTHER, SECOND_NS, START_NS, Collection, Sensor

from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.calibrating.calibrator import Calibrator, Fitted, StopRule, expected_gain
from tactile_nodes.learning.calibrating.files import Source
from tactile_nodes.learning.calibrating.presses import BagPresses, finish, new_file, take_presses, write_calibration
from tactile_nodes.learning.recorded.bags import CollectionBag, Frame, RecordedPress
from tactile_nodes.messages import types
from tactile_nodes.model_file import load_model, save_model

pytestmark = pytest.mark.usefixtures('own_cache')

RULE = StopRule(least=20, most=100, worth=0.1, agree=2)
Calibrated = tuple[Calibrator, list[str]]
"""A calibrator that has fitted, and the lines that were shown."""
ENTRIES = [{'id': '0123456789ab', 'gel': 'gel-7', 'attempts': 16, 'problems': [], 'clocks': []}]


def fits(*errors_n: float) -> list[Fitted]:
    """Fits after 5, 10, 20, 40, ... presses, with places a tenth as far off in mm as forces in N."""
    return [Fitted(5 * 2**step, error, error / 10) for step, error in enumerate(errors_n)]


def changed_press(recorded: RecordedPress, **changed: Any) -> RecordedPress:
    """The press with other words of its message."""
    message: Any = recorded.message
    return dataclasses.replace(recorded, message=dataclasses.replace(message, **changed))


@pytest.fixture(scope='module')
def pressed(other_bag: Path) -> list[RecordedPress]:
    with CollectionBag(other_bag) as bag:
        return list(bag.presses())


def fit_to(calibrator: Calibrator, presses: Iterable[RecordedPress]) -> None:
    for press in presses:
        calibrator.take(press)
    calibrator.fit(ENTRIES)


@pytest.fixture
def calibrator(first_model: Path, own_cache: Path) -> Iterator[Calibrator]:
    with closing(Calibrator(load_model(first_model), {'id': 'gel-7'})) as made:
        yield made


@pytest.fixture(scope='module')
def calibrated(first_model: Path, other_bag: Path, own_cache: Path) -> Iterator[Calibrated]:
    """Of ten presses with one fit in between and one at the end, and the lines that were shown."""
    rule = StopRule(most=10, first=6)
    lines: list[str] = []
    made = Calibrator(load_model(first_model), {'id': 'gel-7'}, rule)
    with closing(made), closing(BagPresses([other_bag])) as presses:
        take_presses(made, presses, lines.append)
        finish(made, presses, lines.append)
        yield made, lines


def test_errors_that_still_fall_call_for_more_presses() -> None:
    """0.4 / n^1 N: twice as many presses halve it."""
    falling = fits(0.08, 0.04, 0.02, 0.01)
    assert expected_gain(falling) == pytest.approx(0.5)
    assert RULE.reason(40, falling) == ''


def test_errors_at_their_floor_end_the_presses_and_the_reason_names_the_share() -> None:
    flat = fits(0.02, 0.011, 0.01, 0.01, 0.01)
    assert 'twice the presses' in RULE.reason(80, flat)
    assert 'the required 10 %' in RULE.reason(80, flat)


def test_one_fit_alone_does_not_end_the_presses() -> None:
    """The last of these expects little, the one before still a lot."""
    bent = fits(0.08, 0.04, 0.02, 0.02, 0.02)
    assert expected_gain(bent[:3]) > 0.1 > expected_gain(bent)
    once, twice = dataclasses.replace(RULE, agree=3), dataclasses.replace(RULE, agree=1)
    assert once.reason(80, bent) == ''
    assert twice.reason(80, bent)


def test_few_presses_never_end_it_and_many_always_do() -> None:
    flat = fits(0.01, 0.01, 0.01, 0.01)
    assert RULE.reason(19, flat) == ''
    assert RULE.reason(20, flat)
    assert 'the greatest number of 100 presses is reached' in RULE.reason(100, [])


def test_a_press_is_read_before_a_fit_has_seen_it(calibrated: Calibrated) -> None:
    calibrator, _ = calibrated
    assert [read.number for read in calibrator.read] == list(range(1, 11))
    assert [read.after is None for read in calibrator.read] == [True] * 6 + [False] * 4


def test_presses_that_no_fit_has_seen_are_read_better_with_the_calibration(calibrated: Calibrated) -> None:
    fresh = [read for read in calibrated[0].read if read.after is not None]
    before = np.median([abs(read.before.off_n) for read in fresh])
    after = np.median([abs(read.after.off_n) for read in fresh if read.after])
    assert after < before / 2


def test_held_out_errors_are_reported_with_what_more_presses_would_give(calibrated: Calibrated) -> None:
    calibrator, lines = calibrated
    assert [fit.presses for fit in calibrator.fits] == [6, 10]
    lines_of_errors = [line for line in lines if 'off on held-out presses' in line]
    assert lines_of_errors[0].startswith('6 presses: ')
    assert any('no more presses: the greatest number of 10 presses is reached' in line for line in lines)


def test_a_calibration_takes_every_picture_of_a_window(calibrated: Calibrated) -> None:
    calibrator, _ = calibrated
    assert calibrator.recordings is not None and calibrator.calibration is not None
    assert calibrator.recordings.contact.sum() == 3 * 10
    assert calibrator.calibration.presses == 10


def test_the_file_names_gel_source_presses_and_errors(
    calibrated: Calibrated, first_model: Path, other_bag: Path, tmp_path: Path
) -> None:
    source, file = Source.find(str(first_model)), tmp_path / 'gel-7_01.safetensors'
    in_use = {'model': 'older.safetensors', 'model_id': 'aaaabbbbcccc', 'gel': 'gel-7'}
    model_id, _ = write_calibration(source, calibrated[0], file, begun_ns=perf_ns(), command='', replaces=in_use)
    loaded = load_model(file)
    with CollectionBag(other_bag) as bag:
        list(bag.presses())
        assert loaded.card['data']['bags'] == [bag.bag_id]
    assert (loaded.model_id, loaded.gel) == (model_id, 'gel-7')
    assert loaded.card['source']['model_id'] == source.loaded.model_id
    assert loaded.card['replaces'] == in_use
    said = loaded.card['training']['calibration']
    assert said['presses'] == 10
    assert said['after']['force_rmse_n'] < said['before']['force_rmse_n'] / 2


def test_every_calibration_gets_a_file_of_its_own(tmp_path: Path) -> None:
    assert new_file(tmp_path, 'gel 7/b').name == 'gel-7-b_01.safetensors'
    (tmp_path / 'gel_01.safetensors').touch()
    assert new_file(tmp_path, '').name == 'gel_02.safetensors'


def test_too_few_presses_are_an_objection_and_no_error_until_the_end(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    fit_to(calibrator, pressed[:4])
    assert calibrator.calibration is None
    assert 'needs presses at least at 5 places, but there are 4' in calibrator.objection


def test_as_many_presses_of_which_some_are_others_are_fitted_anew(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    """The rig finds presses 5 and 6 doubtful after the fit, and two more come, at places of others."""
    fit_to(calibrator, pressed[:6])
    first = calibrator.calibration
    calibrator.fit(ENTRIES)
    assert first is calibrator.calibration is not None
    suspects = [changed_press(press, status=types.Press.STATUS_SUSPECT) for press in pressed[4:6]]
    fit_to(calibrator, [*suspects, changed_press(pressed[0], press=7), changed_press(pressed[1], press=8)])
    assert calibrator.presses == 6
    assert 'at least at 5 places, but there are 4' in calibrator.objection


def test_presses_in_one_corner_are_an_objection_that_says_so(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    places = [press.message.position for press in pressed[:8]]
    corner = [types.Point(x=0.1 * at.x, y=0.1 * at.y) for at in places]
    fit_to(calibrator, [changed_press(press, position=at) for press, at in zip(pressed, corner, strict=False)])
    assert 'press all over the surface' in calibrator.objection


def test_a_sensor_that_was_never_tared_is_an_objection_that_says_so(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    forces = [types.Vector3(z=press.message.wrench.force.z - 0.5) for press in pressed[:10]]
    untared = [types.Wrench(force=each) for each in forces]
    fit_to(calibrator, [changed_press(press, wrench=each) for press, each in zip(pressed, untared, strict=False)])
    assert calibrator.calibration is None
    assert 'tare the force sensor' in calibrator.objection


def test_a_press_that_the_rig_rejected_is_left_out_with_its_reason(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    rejected = changed_press(pressed[0], status=types.Press.STATUS_REJECTED, reason='the camera was silent')
    assert calibrator.take(rejected) is None
    assert calibrator.left_out.endswith('rejected by the rig (the camera was silent)')
    suspect = changed_press(pressed[5], status=types.Press.STATUS_SUSPECT, reason='an axis sticks')
    assert calibrator.take(suspect) is None
    assert calibrator.left_out == f'press {suspect.message.press}: an axis sticks'


def test_presses_on_two_gels_are_refused(calibrator: Calibrator, pressed: list[RecordedPress], tmp_path: Path) -> None:
    later_ns = START_NS + 3600 * SECOND_NS
    collection = Collection(tmp_path / 'third', Sensor(dataclasses.replace(OTHER, seed=3)), later_ns)
    collection.reference(0)
    collection.press(0, 1, 2.0, 3.0, 1.0)
    with CollectionBag(collection.close()) as bag:
        third = next(iter(bag.presses()))
    calibrator.take(pressed[0])
    with pytest.raises(DatasetError, match='another gel, or the camera was moved far'):
        calibrator.take(third, bag=1)


def test_presses_on_another_gel_than_the_running_sensor_sees_are_refused(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    calibrator.take(pressed[0])
    calibrator.live_rest = Sensor(dataclasses.replace(OTHER, seed=3)).rest()
    with pytest.raises(DatasetError, match='the running sensor shows other markers'):
        calibrator.take(pressed[1])


def test_a_rest_image_that_comes_while_another_is_compared_is_compared_next(
    calibrator: Calibrator, pressed: list[RecordedPress], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node's thread takes rest images while the calibration's compares."""
    calibrator.take(pressed[0])
    calibrator.live_rest, compare = Sensor(OTHER).rest(), calibrator.require_gel

    def meanwhile(picture: np.ndarray, what: str) -> None:
        compare(picture, what)
        calibrator.live_rest = Sensor(dataclasses.replace(OTHER, seed=3)).rest()

    monkeypatch.setattr(calibrator, 'require_gel', meanwhile)
    calibrator.require_live_gel()
    with pytest.raises(DatasetError, match='the running sensor shows other markers'):
        calibrator.require_live_gel()


def test_the_running_sensor_may_have_a_rest_image_of_its_own(
    calibrator: Calibrator, pressed: list[RecordedPress]
) -> None:
    calibrator.live_rest = Sensor(OTHER).rest()
    assert calibrator.take(pressed[0]) is not None


def test_images_of_another_size_are_refused(calibrator: Calibrator, pressed: list[RecordedPress]) -> None:
    def smaller(frame: Frame) -> Frame:
        return dataclasses.replace(frame, image=np.ascontiguousarray(frame.image[60:-60, 60:-60]))

    press = pressed[0]
    assert press.reference is not None
    small = dataclasses.replace(
        press,
        frames=tuple(map(smaller, press.frames)),
        untouched=(),
        before=(),
        reference=smaller(press.reference),
    )
    with pytest.raises(ModelError, match=r'have 320x320 pixels, but model .* needs 440x440'):
        calibrator.take(small)


def test_a_calibration_for_this_gel_is_no_model_to_begin_with(first_model: Path, tmp_path: Path) -> None:
    loaded, file = load_model(first_model), tmp_path / 'again.safetensors'
    source = {'model': 'first.safetensors', 'model_id': loaded.model_id}
    card: dict[str, Any] = {name: loaded.card[name] for name in ('flow', 'encoding', 'crop_px')}
    save_model(
        file, loaded.model, {**card, 'gel': {'id': 'gel-7'}, 'data': {'origin': 'calibration'}, 'source': source}
    )
    with pytest.raises(ModelError, match=r'already calibrated for gel gel-7; .* first\.safetensors'):
        Calibrator(load_model(file), {'id': 'gel-7'})


@pytest.mark.parametrize(
    ('model', 'said'),
    [('paper', 'only an axisymmetric response can be transferred'), ('fast', 'measured place by place')],
)
def test_a_model_that_no_other_gel_can_take_over_is_refused_before_anything_is_pressed(
    model: str, said: str, own_cache: Path
) -> None:
    with pytest.raises(ModelError, match=said):
        Calibrator(Source.find(model).loaded, {'id': 'gel-7'})
