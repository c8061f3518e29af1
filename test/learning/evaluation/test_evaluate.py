"""Evaluation of small models made by hand, on presses that are rendered for it."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from coarse_model import config_of, random_network

from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.evaluation import picture
from tactile_nodes.learning.evaluation.evaluate import (
    Evaluation,
    evaluate,
    evaluate_put_aside,
    evaluation_config,
    simulated_words,
)
from tactile_nodes.learning.evaluation.picture import cell_medians, draw
from tactile_nodes.learning.evaluation.tables import comparison, report, write_estimates
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.source import simulated_data
from tactile_nodes.model_file import load_model, save_model
from tactile_nodes.sensing.explain.network import TotalSpread

pytestmark = pytest.mark.usefixtures('own_cache')


FEW = {'presses': 20, 'frames_per_rest_image': 2, 'processes': 1}
SPREAD = TotalSpread(0.5, 0.1)


def random_model(file: Path, seed: int = 1) -> Path:
    return random_network(file, config_of(**FEW), seed=seed, spread=SPREAD)


def of_origin(file: Path, origin: dict[str, object], seed: int = 1, **data: object) -> Path:
    return random_network(file, config_of(**FEW, **data), seed=seed, spread=SPREAD, origin=origin)


@pytest.fixture(scope='module')
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return random_model(tmp_path_factory.mktemp('models') / 'nonsense.safetensors')


@pytest.fixture(scope='module')
def scores(model: Path, own_cache: Path) -> Evaluation:
    return evaluate(model, presses=16)


def test_presses_rest_and_light_touches_are_scored(scores: Evaluation) -> None:
    assert scores.rest is not None
    assert scores.light is not None
    assert scores.groups['all presses'].presses + scores.rest.frames == 20
    assert scores.light.touches == 8
    assert scores.force_uncertainty is not None
    assert scores.position_uncertainty is None
    assert (scores.answers.depth_mm[scores.answers.touched] >= 0.25).all()


@pytest.mark.parametrize('seed', [2, 3])
def test_the_trainings_own_seed_is_refused_for_each_set(model: Path, seed: int) -> None:
    with pytest.raises(ModelError, match='was trained on presses of seed 3'):
        evaluate(model, presses=16, seed=seed)


def test_scores_as_json_say_null_of_what_is_unknown(scores: Evaluation) -> None:
    plain = json.loads(json.dumps(scores.as_dict(), allow_nan=False))
    assert plain['position_uncertainty'] is None
    assert 'answers' not in plain
    assert plain['groups']['all presses']['presses'] == scores.groups['all presses'].presses


def test_unknown_numbers_are_dashes_in_tables(scores: Evaluation) -> None:
    row = comparison([scores]).rows[0]
    assert row[0] == 'nonsense'
    assert row[-1] == '-'  # it states no uncertainty of places
    assert row[-2].endswith('%')


def test_several_models_stand_side_by_side(scores: Evaluation, tmp_path: Path) -> None:
    other = evaluate(random_model(tmp_path / 'other.safetensors', seed=2), presses=16)
    assert other.fingerprint == scores.fingerprint
    text = report([scores, other])
    assert text.startswith('side by side')
    assert {'model nonsense', 'model other'} <= {line.split(' (')[0] for line in text.splitlines()}


def test_a_gel_that_is_simulated_otherwise_now_is_reported(tmp_path: Path) -> None:
    config = config_of(**FEW)
    file = random_model(tmp_path / 'old.safetensors')
    gel = {**asdict(config.gel), 'id': 'ofanearlier'}
    card = {'flow': {'name': 'dis', 'options': {}}, 'encoding': dataclasses.asdict(config.encoding), 'crop_px': 440}
    loaded = load_model(file)
    save_model(file, loaded.model, {**card, 'gel': gel, 'data': loaded.card['data']})
    changed = load_model(file)
    assert 'NOT the gel of the training, ofanearlier' in simulated_words(changed, evaluation_config(changed, 8, 1001))


def test_presses_stay_on_a_smaller_gel(tmp_path: Path) -> None:
    """Within 27 of the 32 mm of the paper's gel, so within 16.875 of 20 mm."""
    loaded = load_model(random_model(tmp_path / 'small.safetensors'))
    card = {**loaded.card, 'gel': {**loaded.card['gel'], 'size_mm': 20.0}}
    assert evaluation_config(dataclasses.replace(loaded, card=card), 8, 1001).data.reach_mm == 16.875 / 2
    assert evaluation_config(loaded, 8, 1001).data.reach_mm == 13.5


def test_what_training_put_aside_of_a_grid_is_scored_for_others_too(model: Path, tmp_path: Path) -> None:
    data = simulated_data(config_of(**FEW, plan='paper'), Progress())
    origin = {**data.origin, 'fingerprint': data.dataset.fingerprint}
    grid = of_origin(tmp_path / 'grid.safetensors', origin, plan='paper')
    own = evaluate_put_aside(grid)
    assert own.groups['all presses'].presses == 4  # a fifth of 20
    assert 'put aside by sample of the paper plan' in own.data
    np.testing.assert_allclose(evaluate_put_aside(model, of=grid).answers.place_mm, own.answers.place_mm)
    other = of_origin(tmp_path / 'other.safetensors', {**origin, 'split_id': 'another'}, seed=2, plan='paper')
    with pytest.raises(ModelError, match='may have seen the test set of that one'):
        evaluate_put_aside(other, of=grid)
    with pytest.raises(ModelError, match='has no simulated test set'):
        evaluate_put_aside(grid, of=model)
    coarse_origin = {**origin, 'plan': 'coarse', 'split_id': 'c'}
    coarse = of_origin(tmp_path / 'coarse.safetensors', coarse_origin, plan='coarse')
    with pytest.raises(ModelError, match='may have seen the test set of that one'):
        evaluate_put_aside(coarse, of=grid)
    real = of_origin(tmp_path / 'real.safetensors', {'origin': 'recorded'}, seed=2, plan='paper')
    with pytest.raises(ModelError, match='was not trained on the simulated gel'):
        evaluate_put_aside(real, of=grid)


def test_cells_of_the_error_map_hold_the_median_of_their_presses() -> None:
    place = np.array([[-1.0, -1.0]] * 3 + [[1.0, -1.0]] * 3 + [[1.0, 1.0]] * 2)
    medians = cell_medians(place, np.array([1.0, 2.0, 9.0, 4.0, 5.0, math.nan, 7.0, 7.0]), np.array([-2.0, 0.0, 2.0]))
    assert medians[0, 0] == 2.0  # rows along +y, columns along +x
    assert np.isnan([medians[0, 1], medians[1, 1], medians[1, 0]]).all()  # fewer than three


def test_a_picture_is_drawn(scores: Evaluation, tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    draw(scores.answers, 'nonsense', tmp_path / 'errors.png')
    assert (tmp_path / 'errors.png').read_bytes().startswith(b'\x89PNG')


def test_presses_of_unknown_depth_are_drawn_one_by_one(scores: Evaluation) -> None:
    pytest.importorskip('matplotlib')
    touched = scores.answers[scores.answers.touched]
    by_hand = dataclasses.replace(touched, depth_mm=np.full(len(touched), math.inf))
    axes = picture.subplots(1, 2)[1]
    picture._map(axes[0, 0], by_hand, by_hand.away_mm, 'error of the place', 'mm')
    picture._true_against_found(axes[0, 1], by_hand)
    shown = [np.asarray(axis.collections[0].get_offsets()) for axis in axes[0]]
    assert shown[0] == pytest.approx(by_hand.place_mm)
    assert shown[1] == pytest.approx(np.stack([by_hand.force_n, by_hand.total_n], axis=1))


def test_each_sample_is_reported_beside_the_truth(scores: Evaluation, tmp_path: Path) -> None:
    made = dataclasses.replace(
        scores.answers[:3],
        place_mm=np.array([[1.0, -2.0], [0.0, 0.0], [3.0, 4.0]]),
        depth_mm=np.array([0.5, -1.0, math.inf]),
        true_n=np.array([[0.25, 0.5], [0.0, 0.0], [1.0, 0.0]], np.float32),
        found_mm=np.array([[1.5, -2.25], [0.0, 0.0], [3.0, 4.0]]),
        total_n=np.array([0.5, 0.0, 1.25]),
        stated_sigma_n=np.array([0.125, 0.0625, math.nan]),
        status=np.array([0, 1, 2]),
        contact_threshold_n=0.1,
    )
    write_estimates(made, tmp_path / 'new' / 'estimates.csv')
    rows = list(csv.DictReader((tmp_path / 'new' / 'estimates.csv').read_text().splitlines()))
    first = {'x_mm': 1.0, 'y_mm': -2.0, 'told_x_mm': 1.5, 'told_y_mm': -2.25}
    first |= {'force_n': 0.75, 'told_force_n': 0.5, 'told_sigma_n': 0.125}
    assert {name: float(rows[0][name]) for name in first} == first
    assert [row['sample'] for row in rows] == ['1', '2', '3']
    assert [row['status'] for row in rows] == ['ok', 'degraded', 'invalid']
    assert (rows[1]['x_mm'], rows[1]['told_x_mm'], rows[2]['told_sigma_n']) == ('', '', '')


def test_estimates_replace_earlier_ones_but_no_other_table(scores: Evaluation, tmp_path: Path) -> None:
    """A lab may take `tactile evaluate --table` for the table of its presses."""
    write_estimates(scores.answers[:3], tmp_path / 'estimates.csv')
    write_estimates(scores.answers[:1], tmp_path / 'estimates.csv')
    assert len((tmp_path / 'estimates.csv').read_text().splitlines()) == 2
    (tmp_path / 'presses.csv').write_text('picture,x_mm,y_mm,force_g\n')
    with pytest.raises(DatasetError, match=r'presses.csv is not a table of estimates and is not replaced'):
        write_estimates(scores.answers[:1], tmp_path / 'presses.csv')
    assert (tmp_path / 'presses.csv').read_text() == 'picture,x_mm,y_mm,force_g\n'
