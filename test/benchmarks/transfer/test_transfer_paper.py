"""The benchmark of the paper's transfer, in small: every way is measured, on both tests, and the page says so."""

from __future__ import annotations

import dataclasses
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / 'learning'))

from tiny_training import tiny_config, tiny_presses

from benchmarks import transfer_paper
from benchmarks.harness.report import surroundings
from benchmarks.transfer_paper import Presses, answers, layer_settings, measure, metrics_of
from benchmarks.transfer_paper.page import draw, page
from benchmarks.transfer_paper.scores import AS_IT_IS, NEW, OWN, PUBLISHED, REST, WAYS, Score
from benchmarks.transfer_paper.steps import FirstSteps, first_steps, variants
from tactile_nodes.cli.main import main
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.fit import fit_network
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.network import CalibrationLayer, NetworkReadout

pytestmark = pytest.mark.skipif(find_spec('torch') is None, reason='torch is not installed')
PLAIN = surroundings('tactile bench transfer_paper')
CONFIG = tiny_config({'hidden': (20,)}, epochs=8, learning_rate=0.01, rest_repeats=0)


def polar(dataset: Dataset, motion_gain: float = 1.0) -> Dataset:
    touched = dataset.take(np.flatnonzero(dataset.presses[:, 3] > 0))
    dx, dy = np.moveaxis(touched.features.astype(np.float64), -1, 0)
    features = np.stack([motion_gain * np.hypot(dx, dy), np.arctan2(dy, dx) % (2 * np.pi)], axis=-1)
    return dataclasses.replace(touched, features=features.astype(np.float16))


@pytest.fixture(scope='module')
def source() -> NetworkReadout:
    dataset = polar(tiny_presses(300))
    return fit_network(dataset, np.arange(len(dataset.presses)) % 5 == 1, CONFIG, Progress())[0]


@pytest.fixture(scope='module')
def presses() -> Presses:
    return Presses(0, polar(tiny_presses(120, seed=3), 0.6), polar(tiny_presses(60, seed=4), 0.6))


@pytest.fixture(scope='module')
def scores(source: NetworkReadout, presses: Presses) -> list[Score]:
    return measure(source, presses, [60], 2, dataclasses.replace(CONFIG), lambda text: None)


def test_every_way_is_measured_on_both_tests(scores: list[Score]) -> None:
    assert {each.way for each in scores} == set(WAYS)
    assert [each.tested for each in scores] == [REST, NEW] * len(WAYS)
    assert all(np.isfinite([each.armse_n, each.d_loc_mm, each.rmse_mc_n]).all() for each in scores)
    assert all(each.epochs > 0 for each in scores if each.way != AS_IT_IS)
    assert all(each.presses == (0 if each.way == AS_IT_IS else 60) for each in scores)


def test_all_samples_at_once_are_read_as_one_by_one(source: NetworkReadout, presses: Presses) -> None:
    random = np.random.default_rng(1)
    change = (0.01 * random.normal(size=(72, 72))).astype(np.float16)
    readout = dataclasses.replace(source, layer=CalibrationLayer.of_change(change, np.full(72, 0.01, np.float32)))
    # None of these presses belongs to the first rest image.
    few = dataclasses.replace(presses.new.take(np.arange(5)), rest=np.ones(5, int), confidence=np.ones((2, 6, 6), 'f4'))
    one_by_one = [readout.read(v.astype(np.float32), few.confidence[i]).normal_force_n for v, i in _frames(few)]
    np.testing.assert_allclose(answers(readout, few), np.reshape(one_by_one, (5, -1)), atol=1e-5)


def _frames(dataset: Dataset) -> list[tuple[np.ndarray, int]]:
    return list(zip(dataset.features, dataset.rest.tolist(), strict=True))


def test_a_set_twice_as_large_has_the_same_armse(
    source: NetworkReadout, presses: Presses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over groups of as many presses; over all of them at once it would grow."""
    monkeypatch.setattr(transfer_paper, 'GROUP', 54)
    once, twice = presses.new, presses.new.take(np.tile(np.arange(54), 2))
    assert len(once.presses) == 54
    assert metrics_of(source, twice) == pytest.approx(metrics_of(source, once), rel=1e-5)


def test_the_published_settings_differ_from_a_tenth_by_the_rate_alone() -> None:
    letter, tenth, _ = layer_settings(30).values()
    assert (letter.learning_rate, letter.batch, letter.dropout, letter.patience) == (1e-4, 64, 0.05, 30)
    assert dataclasses.replace(tenth, learning_rate=1e-4) == letter


def test_the_first_step_moves_no_unit_further_than_the_sum_of_its_inputs_allows(
    source: NetworkReadout, presses: Presses
) -> None:
    """Nadam's first step is 1.056 times the rate for every weight (its momentum's schedule begins at 0.45)."""
    found = {each.setting: each for each in first_steps(source, presses.grid)}
    assert list(found) == list(variants())
    for each in found.values():
        assert 0 < each.moved_px < 1.3 * each.most_px
    published, centred = found['as published'], found['features minus their mean']
    assert published.start_n == centred.start_n
    assert centred.moved_px < 0.5 * published.moved_px
    assert found['a tenth of the rate'].moved_px == pytest.approx(published.moved_px / 10, rel=0.2)


def result(scores: list[Score], steps: list[FirstSteps]) -> dict[str, Any]:
    return {**PLAIN, 'scores': list(map(dataclasses.asdict, scores)), 'steps': list(map(dataclasses.asdict, steps))}


def test_page_and_figure_name_every_way_and_the_own_gel(scores: list[Score], tmp_path: Path) -> None:
    own = [dataclasses.replace(each, gel=OWN) for each in scores if each.way == AS_IT_IS]
    steps = [FirstSteps('as published', 1e-4, 0.5, 0.4, 3.9, 0.04, 0.09, 0.08, 0.08, 0.02)]
    text = page(result([*own, *scores], steps))
    rows = [line.split('|')[1].strip() for line in text.splitlines() if line.startswith('|')]
    assert {'own gel', *WAYS, 'as published'} <= set(rows)
    published = next(line for line in text.splitlines() if line.startswith(f'| {PUBLISHED}'))
    score = next(each for each in scores if (each.way, each.tested) == (PUBLISHED, NEW))
    assert f'{score.armse_n:.4f}' in published
    assert 'With 60 presses `layer as it ships` on the rest of the 800: aRMSE' in text
    draw(result([*own, *scores], steps), tmp_path, 'figure')
    assert (tmp_path / 'figure.png').stat().st_size > 10_000


def test_the_worst_gel_stands_beside_the_median(scores: list[Score]) -> None:
    own = [dataclasses.replace(each, gel=OWN) for each in scores if each.way == AS_IT_IS]
    worse = [dataclasses.replace(each, gel=1, armse_n=0.5) for each in scores]
    text = page(result([*own, *scores, *worse], []))
    assert text.count('(0.5000)') == 2 * len(WAYS)


@pytest.mark.parametrize('words', [['--gels', '0'], ['--presses', '10'], ['--presses', '750']])
def test_what_cannot_be_measured_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['bench', 'transfer_paper', *words]) == 1
    assert f'{words[0]} must be at ' in capsys.readouterr().err
