"""Transfer: a gel that differs from a known one in known ways is read after a few presses."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from responding_gel import NOISE_PX, REACH_MM, motion, presses, seen_with_noise

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.transfer.calibration import cautious
from tactile_nodes.learning.transfer.checks import require_tared, require_unit
from tactile_nodes.learning.transfer.fit import FORMS, OtherGel, Transfer, folds_of, transfer
from tactile_nodes.learning.transfer.whole import RIM_SCATTER, Typical, changed, fit_whole
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.arrays import AnyReadout, readout_arrays, readout_from
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.geometry import BinGrid

SOFTER = 1.25
AWAY_MM = np.array([0.8, -0.5])


def other_gel(count: int, seed: int, reach_mm: float = REACH_MM - 1) -> Dataset:
    """Presses on a softer gel, over a camera that is aside: it answers as the first does 0.8 and -0.5 mm away."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-reach_mm, reach_mm, (count, 2)), random.uniform(0.05, 0.75, count)
    force = np.concatenate([force, np.zeros(20)])
    places = np.concatenate([places, np.zeros((20, 2))])
    return seen_with_noise(motion(places + AWAY_MM, SOFTER * force), places, force, random)


@pytest.fixture(scope='module')
def made(known_gel: AxisymmetricReadout) -> Transfer:
    return transfer(known_gel, other_gel(25, seed=3))


def errors(readout: AnyReadout, dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Distances of place (mm) and errors of force (N) of the presses."""
    touched = np.flatnonzero(dataset.presses[:, 2] > 0)
    read = [readout.read(dataset.features[i].astype(np.float32), dataset.confidence[0]).contacts[0] for i in touched]
    place = np.array([(each.x_mm, each.y_mm) for each in read]) - dataset.presses[touched, :2]
    return np.hypot(*place.T), np.array([each.force_n for each in read]) - dataset.presses[touched, 3]


def giving_way(dataset: Dataset, px_per_n: float) -> Dataset:
    """The same presses under a camera whose mounting gives way: the force shifts and turns the picture."""
    along = np.linspace(-1.0, 1.0, 6)
    x, y = np.meshgrid(along, along)
    moved = px_per_n * np.stack([1.0 - 0.5 * y, 0.3 + 0.5 * x], axis=-1)
    force = np.maximum(dataset.presses[:, 3], 0.0)[:, None, None, None]
    return dataclasses.replace(dataset, features=(dataset.features + force * moved).astype(np.float16))


@pytest.mark.parametrize('px_per_n', [0.05, 0.5])
def test_a_mounting_that_gives_way_under_the_force_spoils_no_calibration(
    known_gel: AxisymmetricReadout, made: Transfer, px_per_n: float
) -> None:
    """Least squares find the motion of the camera exactly, so its size makes no difference."""
    given = transfer(known_gel, giving_way(other_gel(25, seed=3), px_per_n))
    fresh = other_gel(60, seed=4)
    (place, force), (usual_place, usual_force) = (
        errors(each.readout, dataset) for each, dataset in ((given, giving_way(fresh, px_per_n)), (made, fresh))
    )
    assert np.median(place) < 1.1 * np.median(usual_place)
    assert np.sqrt(np.mean(force**2)) < 1.1 * np.sqrt(np.mean(usual_force**2))
    # Along x and y the regions move by this root mean square: they shift by 1 and 0.3, and turn by 0.5 at the rim.
    turned = 0.5 * np.sqrt(2 * np.mean(np.linspace(-1, 1, 6) ** 2))
    assert given.gives_px == pytest.approx(px_per_n * np.hypot(np.hypot(1.0, 0.3), turned), rel=0.3)
    assert 'the mounting of the camera gives way under the force' in given.mounting
    assert 'or the sides of the gel are free' in given.mounting
    by_field = dataclasses.replace(given, field='regions').mounting
    assert 'or the body is wide' in by_field
    assert 'sides' not in by_field
    assert not made.mounting


def test_what_the_sides_of_a_gel_add_spoils_no_calibration_that_knows_it(
    known_gel: AxisymmetricReadout, made: Transfer
) -> None:
    """Motion around the press that grows with the force and towards the sides, in another direction at each."""
    patches = PatchGrid(known_gel.bins)
    x, y = patches.centres_mm.T / REACH_MM
    away = np.square(patches.centres_mm[:, None] - known_gel.response.places).sum(axis=-1)
    per_n = np.stack([x**3, -(y**3)], axis=-1)[:, None] * np.exp(-away / 50)[..., None]
    sides = BySides(patches, per_n.astype(np.float32))

    def moved(dataset: Dataset) -> Dataset:
        contacts = np.maximum(dataset.presses[:, [0, 1, 3]].astype(float), [-np.inf, -np.inf, 0.0])
        added, _ = sides.motion_and_slopes(contacts)
        features = dataset.features + added.reshape(dataset.features.shape)
        return dataclasses.replace(dataset, features=features.astype(np.float16))

    given = transfer(known_gel, moved(other_gel(25, seed=3)), sides=sides)
    fresh = other_gel(60, seed=4)
    (place, force), (usual_place, usual_force) = (
        errors(each.readout, dataset) for each, dataset in ((given, moved(fresh)), (made, fresh))
    )
    assert np.median(place) < 1.1 * np.median(usual_place)
    assert np.sqrt(np.mean(force**2)) < 1.1 * np.sqrt(np.mean(usual_force**2))
    ignoring = transfer(known_gel, moved(other_gel(25, seed=3)), forced=True)
    assert np.sqrt(np.mean(errors(ignoring.readout, moved(fresh))[1] ** 2)) > 2 * np.sqrt(np.mean(force**2))


def test_the_whole_fit_finds_softness_and_shift(known_gel: AxisymmetricReadout) -> None:
    other = OtherGel.of(known_gel, other_gel(25, seed=3))
    found = fit_whole(other.start, other.presses).response
    # The known gel answers a press here as this one answers a press 0.8 and -0.5 mm less far along: so do its regions.
    assert (found.places - known_gel.response.places).mean(axis=0) == pytest.approx(-AWAY_MM, abs=0.1)
    press = np.array([[0.0, 0.0, 0.4]])
    there = np.array([[*AWAY_MM, 0.4]])
    size = np.linalg.norm(found.motion(press)) / np.linalg.norm(known_gel.response.motion(there))
    assert size == pytest.approx(SOFTER, rel=0.05)


def test_a_gel_so_soft_that_presses_are_beyond_the_known_profiles_is_read_as_hard_as_it_was_pressed(
    known_gel: AxisymmetricReadout,
) -> None:
    softer = 2.0  # what is known ends at 1 N, which is 0.5 N here
    dataset = other_gel(20, seed=5)
    forces = dataset.presses[:, 3].astype(float)
    field = motion(dataset.presses[:, :2].astype(float), softer * np.maximum(forces, 0.0))
    noise = NOISE_PX * np.random.default_rng(6).normal(size=field.shape)
    made = transfer(known_gel, dataclasses.replace(dataset, features=(field + noise).astype(np.float16)))
    kept = readout_from(*readout_arrays(made.readout), BinGrid())
    assert isinstance(kept, AxisymmetricReadout)
    for force in (0.3, 0.6, 0.74):
        shown = motion(np.array([[1.0, -2.0]]), np.array([softer * force]))[0].astype(np.float32)
        assert kept.read(shown, np.ones((6, 6), np.float32)).contacts[0].force_n == pytest.approx(force, rel=0.04)


def test_an_equal_gel_is_left_as_it_is(known_gel: AxisymmetricReadout) -> None:
    same = changed(known_gel.response, np.zeros(13))
    press = np.array([[1.0, 2.0, 0.6]])
    assert same.motion(press) == pytest.approx(known_gel.response.motion(press))


def test_regions_that_the_rim_of_the_gel_cuts_are_held_less(known_gel: AxisymmetricReadout) -> None:
    typical = Typical.of(
        known_gel.response, np.random.default_rng(1).uniform(-0.8, 0.8, known_gel.response.places.shape)
    )
    view = np.array([[0.85, -0.3], [0.2, -0.95]])
    (inside, rim), (expected, at_rim) = typical.precision(view), np.linalg.inv(typical.scatter.covariance(view))
    assert inside == pytest.approx(expected)
    assert rim * RIM_SCATTER == pytest.approx(at_rim)


def test_fresh_presses_are_read_nearly_as_well_as_the_source_reads_its_own(
    known_gel: AxisymmetricReadout, made: Transfer
) -> None:
    place, force = errors(made.readout, other_gel(60, seed=4))
    own_place, own_force = errors(known_gel, presses(60, seed=5))
    assert np.median(place) < 2.5 * np.median(own_place)
    assert np.sqrt(np.mean(force**2)) < 2.5 * np.sqrt(np.mean(own_force**2))


def test_the_form_taken_is_the_simplest_of_those_that_explain_held_out_presses(made: Transfer) -> None:
    best = min(made.misfits.values())
    simpler = list(FORMS)[: list(FORMS).index(made.form)]
    assert made.misfits[made.form] <= 1.02 * best
    assert all(made.misfits[form] > 1.02 * best for form in simpler)
    assert made.reason.startswith(f'{made.form}: ')


def test_regions_fitted_to_few_presses_say_how_unsure_they_are(known_gel: AxisymmetricReadout) -> None:
    few, more = (OtherGel.of(known_gel, other_gel(count, seed=3)) for count in (10, 40))
    asked = np.array([[0.0, 0.0, 0.4]])
    made = [each.regions(each.whole().response) for each in (few, more)]
    off = [each.variance(*each.motion_slopes_and_columns(asked)[1:]).sum() for each in made]
    assert 0 < off[1] < off[0]


def test_the_card_tells_errors_before_and_after(made: Transfer) -> None:
    said = made.as_dict()
    assert said['before']['place_median_mm'] == pytest.approx(np.hypot(*AWAY_MM), abs=0.1)
    assert said['after']['place_median_mm'] < said['before']['place_median_mm']
    assert said['presses'] == 25
    assert 'readout' not in said


def test_five_of_six_fresh_presses_lie_within_the_stated_90_percent(made: Transfer) -> None:
    fresh = other_gel(100, seed=6)
    rows = np.flatnonzero(fresh.presses[:, 2] > 0)
    read = [made.readout.read(fresh.features[i].astype(np.float32), fresh.confidence[0]).contacts[0] for i in rows]
    off = np.array([each.force_n for each in read]) - fresh.presses[rows, 3]
    within = np.abs(off) <= 1.645 * np.array([each.sigma_n for each in read])
    assert within.mean() > 0.83


def test_noise_of_the_rest_image_of_the_presses_is_not_taken_for_the_gel(known_gel: AxisymmetricReadout) -> None:
    """Pictures to come have a rest image of their own; the presses are still measured about theirs."""
    dataset = other_gel(60, seed=3)
    aside = np.random.default_rng(7).normal(scale=0.05, size=dataset.features.shape[1:])
    noisy = dataclasses.replace(dataset, features=(dataset.features + aside).astype(np.float16))
    plain, other = OtherGel.of(known_gel, dataset), OtherGel.of(known_gel, noisy)
    assert other.presses.motion == pytest.approx(plain.presses.motion, abs=2e-3)
    assert not other.readout(other.start, known_gel.doubt).scaling.mean.any()


def test_a_gel_that_shows_markers_in_too_few_regions_is_refused(known_gel: AxisymmetricReadout) -> None:
    dataset = other_gel(25, seed=3)
    for shown in (0, 11):
        confidence = (np.arange(36) < shown).astype(np.float32).reshape(1, 6, 6)
        with pytest.raises(DatasetError, match=f'only {shown} regions show markers .* a place needs at least 12'):
            transfer(known_gel, dataclasses.replace(dataset, confidence=confidence))


@pytest.mark.parametrize('wrong', [np.nan, np.inf])
def test_motion_or_force_that_is_no_number_is_refused(known_gel: AxisymmetricReadout, wrong: float) -> None:
    dataset = other_gel(25, seed=3)
    features, presses = dataset.features.copy(), dataset.presses.copy()
    features[2, 1, 1, 0] = presses[4, 3] = wrong
    with pytest.raises(DatasetError, match='images in which the motion is not a number: 1'):
        transfer(known_gel, dataclasses.replace(dataset, features=features))
    with pytest.raises(DatasetError, match='images of presses whose place or force is not a number: 1'):
        transfer(known_gel, dataclasses.replace(dataset, presses=presses))


def test_a_region_without_markers_may_have_moved_by_what_is_no_number(known_gel: AxisymmetricReadout) -> None:
    dataset = other_gel(25, seed=3)
    features, confidence = dataset.features.copy(), dataset.confidence.copy()
    features[:, 0, 0], confidence[:, 0, 0] = np.nan, 0.0
    made = transfer(known_gel, dataclasses.replace(dataset, features=features, confidence=confidence))
    assert made.after.place_median_mm < 0.1 * made.before.place_median_mm


def test_a_gel_of_which_the_source_reads_nothing_is_calibrated_and_its_card_is_json(
    known_gel: AxisymmetricReadout,
) -> None:
    """The model knows the regions 0 to 19 of 36, the gel shows 12 to 35: eight in common, four too few."""
    known, dataset, response = np.arange(36) < 20, other_gel(25, seed=3), known_gel.response
    part = dataclasses.replace(
        known_gel,
        scaling=dataclasses.replace(known_gel.scaling, trusted=known.astype(np.float32).reshape(6, 6)),
        response=dataclasses.replace(response, places=response.places[known], couplings=response.couplings[known]),
    )
    shown = (np.arange(36) >= 12).astype(np.float32).reshape(1, 6, 6)
    made = transfer(part, dataclasses.replace(dataset, confidence=shown))
    entry = json.loads(json.dumps(made.as_dict(), allow_nan=False))
    assert entry['before'] == {'force_rmse_n': None, 'force_median_n': None, 'place_median_mm': None}
    assert entry['after']['place_median_mm'] < 0.2


@pytest.mark.parametrize(('times', 'said'), [(9.81e-3, 'times as soft'), (102.0, 'times as hard')])
def test_grams_and_newtons_that_are_mistaken_for_each_other_are_refused_unless_forced(
    times: float, said: str, known_gel: AxisymmetricReadout
) -> None:
    dataset = other_gel(25, seed=3)
    wrong = dataset.presses * np.array([1.0, 1.0, 1.0, times])
    require_unit(100.0, forced=True)
    with pytest.raises(DatasetError, match=f'{said} as that of the model: check the unit of the forces'):
        transfer(known_gel, dataclasses.replace(dataset, presses=wrong))


def test_an_offset_that_few_presses_do_not_bear_out_is_no_reason_to_refuse() -> None:
    require_tared(-0.11, 0.03)
    with pytest.raises(DatasetError, match=r'forces seem to be -0\.14 N'):
        require_tared(-0.14, 0.03)


def test_the_spread_of_an_offset_is_that_of_fits_without_a_fold_each(
    known_gel: AxisymmetricReadout, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jackknife: of five estimates that are 0 to 0.4 N, 4/5 of 0.1 N^2 squared off their mean, 0.283 N."""
    other = OtherGel.of(known_gel, other_gel(10, seed=3))
    fold = np.arange(10) % 5
    monkeypatch.setattr(OtherGel, 'offset', lambda _, whole, chosen: 0.1 * ({*range(5)} - {*fold[chosen]}).pop())
    assert other.offset_spread(other.whole(), fold) == pytest.approx(np.sqrt(0.8 * 0.1))


def test_forces_that_begin_at_zero_are_found_to(known_gel: AxisymmetricReadout) -> None:
    other = OtherGel.of(known_gel, other_gel(25, seed=3))
    assert fit_whole(other.start, other.presses, offset=True).offset_n == pytest.approx(0.0, abs=0.02)


def test_the_gel_of_the_model_itself_is_not_made_worse(known_gel: AxisymmetricReadout) -> None:
    with pytest.raises(DatasetError, match='would not help'):
        transfer(known_gel, presses(20, seed=9, still=0.6))


def test_presses_at_one_place_are_held_out_together() -> None:
    fold = folds_of(np.array([[0, 0, 1], [1, 0, 1], [0, 0, 2], [2, 0, 1], [3, 0, 1], [4, 0, 1], [5, 0, 1.0]]))
    assert fold.tolist() == [0, 1, 0, 2, 3, 4, 0]


def test_with_ten_presses_the_largest_error_counts() -> None:
    ratios = np.arange(1.0, 101.0)
    assert cautious(ratios, 10) == 100.0
    assert cautious(ratios, 1000) == pytest.approx(91, abs=1.0)
