"""Pictures of a press held still: averaged where they belong together, left out where the tip still moves."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from responding_gel import NOISE_PX, motion, presses, seen_with_noise

from tactile_nodes.learning.axisymmetric.regions import LEAST_NOISE_PX, OWN_NOISE_PX, Presses
from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.holds import holds_of, still, still_holds
from tactile_nodes.learning.datasets.pressed_gels import first_presses, simulate_held
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import BuildOptions, build
from tactile_nodes.learning.transfer.fit import OtherGel, transfer
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.network import InputScaling

pytestmark = pytest.mark.usefixtures('own_cache')

ALL = np.ones((6, 6), np.float32)
SCALING = InputScaling(np.zeros((6, 6, 2), np.float32), np.full((6, 6, 2), 1 / NOISE_PX, np.float32), ALL)


def held(count: int, pictures: int, seed: int) -> Dataset:
    """Presses on a gel that is softer and aside, with so many pictures each, and 20 of the untouched gel."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-9.0, 9.0, (count, 2)), random.uniform(0.05, 0.75, count)
    places = np.concatenate([np.repeat(places, pictures, axis=0), np.zeros((20, 2))])
    force = np.concatenate([np.repeat(force, pictures), np.zeros(20)])
    hold = np.concatenate([np.repeat(np.arange(count), pictures), count + np.arange(20)])
    field = motion(places + np.array([0.8, -0.5]), 1.25 * force)
    return dataclasses.replace(seen_with_noise(field, places, force, random), hold=hold)


def touched(dataset: Dataset) -> np.ndarray:
    return np.flatnonzero(dataset.presses[:, 2] > 0)


@pytest.fixture(scope='module')
def recorded(bag: Path, own_cache: Path) -> RecordedPresses:
    options = BuildOptions(Choice('dis'), Choice('cartesian_mean', {'rows': 8, 'cols': 8}), frames='each')
    return build([bag], options)


def test_four_pictures_have_a_quarter_of_the_variance_of_noise() -> None:
    dataset = held(60, 4, seed=1)
    pressed = Presses.of_holds(dataset, holds_of(dataset, touched(dataset)), SCALING)
    quiet = motion(pressed.contacts[:, :2] + np.array([0.8, -0.5]), 1.25 * pressed.contacts[:, 2])
    off = pressed.motion - quiet.reshape(60, 36, 2)
    # 0.01 px in one picture, so 0.005 px in the mean of four; rounding to 16 bits adds a hundredth of that.
    assert off.std() == pytest.approx(0.005, rel=0.05)


def test_the_flows_own_errors_are_not_averaged_away() -> None:
    dataset = held(5, 4, seed=1)
    pressed = Presses.of_holds(dataset, holds_of(dataset, touched(dataset)), SCALING)
    # (0.01^2 + 0.004^2 - 0.003^2) / 4 + 0.003^2 = 3.575e-5 px^2
    assert (LEAST_NOISE_PX, OWN_NOISE_PX) == (0.004, 0.003)
    assert 1 / pressed.certainty == pytest.approx(3.575e-5)


def test_a_hold_of_one_picture_is_that_picture() -> None:
    dataset = dataclasses.replace(presses(40, seed=2), hold=None)
    rows = touched(dataset)
    one, plain = Presses.of_holds(dataset, holds_of(dataset, rows), SCALING), Presses.of(dataset, rows, SCALING)
    np.testing.assert_array_equal(one.motion, plain.motion)
    np.testing.assert_allclose(one.certainty, plain.certainty)


def test_a_region_that_two_of_four_pictures_show_is_their_mean() -> None:
    dataset = held(5, 4, seed=1)
    hidden = ALL.copy()
    hidden[0, 0] = 0.0
    dataset.features[:2, 0, 0] = 7.0
    dataset = dataclasses.replace(
        dataset, confidence=np.stack([ALL, hidden]), rest=(np.arange(len(dataset.presses)) < 2).astype(int)
    )
    pressed = Presses.of_holds(dataset, holds_of(dataset, touched(dataset)), SCALING)
    assert pressed.motion[0, 0] == pytest.approx(dataset.features[2:4, 0, 0].astype(float).mean(axis=0))
    assert 1 / pressed.certainty[0, 0] == pytest.approx([6.25e-5, 6.25e-5])  # 1.07e-4 / 2 + 0.003^2


def test_a_picture_in_which_the_tip_still_moves_is_left_out() -> None:
    dataset = held(5, 6, seed=1)
    dataset.features[7] *= 0.8  # the second picture of the second press: a fifth of the way is still to go
    holds = still_holds(dataset, touched(dataset), ALL)
    assert [each.tolist() for each in holds[:2]] == [[0, 1, 2, 3, 4, 5], [6, 8, 9, 10, 11]]


def test_noise_alone_leaves_no_picture_out() -> None:
    dataset = held(100, 8, seed=3)
    assert [len(each) for each in still_holds(dataset, touched(dataset), ALL)] == [8] * 100


def test_a_region_that_is_lost_in_one_picture_does_not_make_it_a_moving_one() -> None:
    pictures = motion(np.zeros((8, 2)), np.full(8, 0.5)).reshape(8, 36, 2)
    pictures = pictures + NOISE_PX * np.random.default_rng(4).normal(size=pictures.shape)
    strongest = np.square(pictures[0]).sum(axis=-1).argmax()
    pictures[3, strongest] = 5.0
    assert still(pictures).all()


def test_of_two_pictures_both_count() -> None:
    assert still(np.random.default_rng(1).normal(size=(2, 36, 2))).tolist() == [True, True]


def test_presses_keep_their_order_and_the_first_ones_come_with_all_their_pictures() -> None:
    dataset = held(10, 3, seed=1)
    mixed = dataset.take(np.concatenate([np.arange(0, 30, 3), np.arange(30, 50), np.arange(1, 30, 3)]))
    first = first_presses(mixed, 2)
    assert np.sort(first.presses[touched(first), 0]).tolist() == sorted(np.repeat(dataset.presses[[0, 3], 0], 2))
    alone = first_presses(mixed, 2, pictures=1)
    assert alone.presses[touched(alone), 0].tolist() == dataset.presses[[0, 3], 0].tolist()


def test_a_calibration_fits_to_means_and_is_judged_by_single_pictures(known_gel: AxisymmetricReadout) -> None:
    dataset = held(12, 4, seed=3)
    other = OtherGel.of(known_gel, dataset)
    assert len(other.presses) == len(other.rows) == 12
    assert other.rows.tolist() == list(range(0, 48, 4))
    assert transfer(known_gel, dataset).presses == 12


def test_with_more_pictures_presses_say_more_of_the_gel(known_gel: AxisymmetricReadout) -> None:
    asked, off = np.array([[0.0, 0.0, 0.4]]), []
    for pictures in (1, 8):
        other = OtherGel.of(known_gel, first_presses(held(12, 8, seed=3), 12, pictures=pictures))
        made = other.regions(other.whole().response)
        off.append(made.variance(*made.motion_slopes_and_columns(asked)[1:]).sum())
    assert off[1] < off[0]


def test_stated_uncertainties_are_those_of_single_pictures(known_gel: AxisymmetricReadout) -> None:
    readout = transfer(known_gel, held(25, 8, seed=3)).readout
    fresh = held(150, 1, seed=4)
    rows = touched(fresh)
    read = [readout.read(fresh.features[row].astype(np.float32), ALL).contacts[0] for row in rows]
    off = np.array([each.force_n for each in read]) - fresh.presses[rows, 3]
    assert (np.abs(off) <= 1.645 * np.array([each.sigma_n for each in read])).mean() > 0.83


def test_pictures_of_one_window_have_one_force_and_surround_its_middle(recorded: RecordedPresses) -> None:
    dataset = recorded.as_samples()
    holds = holds_of(dataset, touched(dataset))
    assert {len(each) for each in holds} == {3}  # as many as the windows of these bags have
    for rows in holds:
        begin_ns, end_ns = recorded.window_ns[rows[0]]
        assert len(np.unique(recorded.force_n[rows])) == 1
        # 0, 16.7 and 33.3 ms in a window of 50 ms: half a period beside its middle, as first images are by 25 ms.
        assert (recorded.stamp_ns[rows] - begin_ns).mean() == pytest.approx(16_666_667, abs=1)
        assert end_ns - begin_ns == pytest.approx(50e6, abs=1)


def test_pictures_against_another_rest_image_or_of_another_attempt_are_not_averaged(recorded: RecordedPresses) -> None:
    rows = holds_of(recorded.as_samples(), np.flatnonzero(recorded.contact))[0]
    for name, other in (('reference_id', 'another'), ('attempt', 9)):
        changed = getattr(recorded, name).astype('U16' if name == 'reference_id' else int)
        changed[rows[2]] = other
        dataset = dataclasses.replace(recorded, **{name: changed}).as_samples()
        assert [each.tolist() for each in holds_of(dataset, rows)] == [rows[:2].tolist(), rows[2:].tolist()]


def test_a_data_set_of_first_images_has_holds_of_one(bag: Path, own_cache: Path) -> None:
    options = BuildOptions(Choice('dis'), Choice('cartesian_mean', {'rows': 8, 'cols': 8}))
    dataset = build([bag], options).as_samples()
    assert {len(each) for each in holds_of(dataset, touched(dataset))} == {1}


def test_further_pictures_of_a_simulated_press_differ_from_the_first_by_noise_alone(own_cache: Path) -> None:
    data = DataConfig(
        plan='spread', presses=3, seed=1, without_contact=0.25, presses_per_rest_image=0, frames_per_rest_image=2,
        shallowest_mm=1.0, deepest_mm=1.9, reach_mm=10.0, processes=1,
    )  # fmt: skip
    config = TrainConfig(data=data, flow=Choice('dis'), encoding=Choice('cartesian_mean', {'rows': 8, 'cols': 8}))
    first, three = simulate(config, Progress()), simulate_held(config, 3, Progress())
    np.testing.assert_array_equal(three.features[:4], first.features)
    holds = holds_of(three, touched(three))
    assert [len(each) for each in holds] == [3, 3, 3]
    assert len(three.presses) == 3 * 3 + 1
    for rows in holds:
        pictures = three.features[rows].astype(np.float32)
        assert (three.presses[rows] == three.presses[rows[0]]).all()
        assert 0 < np.abs(pictures[1:] - pictures[0]).mean() < 0.1 * np.abs(pictures).max()
        assert (pictures[1] != pictures[2]).any()
