"""The benchmark of transfer without a rig, in a short form on a gel that is none of its test gels."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from benchmarks.harness.report import surroundings
from benchmarks.transfer_partial import AS_IT_IS, IMAGE, PEN_WEIGHT, Score, measure, page
from tactile_nodes.learning.progress import Progress
from tactile_nodes.model_file import find_model, load_model


@pytest.fixture(scope='module')
def scores() -> dict[str, Score]:
    loaded = load_model(find_model('portable'))
    runs = (IMAGE, 0), (PEN_WEIGHT, 7)
    made = measure(loaded, range(1), Progress(), runs, seed=4242, frames=20)
    return {each['way']: Score(**each) for each in made}


def test_two_rest_images_bring_places_closer_and_forces_not(scores: dict[str, Score]) -> None:
    assert scores[IMAGE].place_median_mm < 0.5 * scores[AS_IT_IS].place_median_mm
    assert scores[IMAGE].force_rmse_n > 0.3 * scores[AS_IT_IS].force_rmse_n


def test_three_pens_and_four_weights_bring_both_closer(scores: dict[str, Score]) -> None:
    assert scores[PEN_WEIGHT].place_median_mm < 0.3 * scores[AS_IT_IS].place_median_mm
    assert scores[PEN_WEIGHT].force_rmse_n < 0.7 * scores[AS_IT_IS].force_rmse_n


def test_the_page_has_median_and_worst_over_the_gels() -> None:
    made = [Score(gel, IMAGE, 0, force, 0.3, 'outline', 1.0) for gel, force in enumerate((0.02, 0.05, 0.03))]
    text = page({**surroundings('tactile bench transfer_partial'), 'scores': list(map(asdict, made))})
    assert '3 simulated gels' in text
    assert '0.0300 (0.0500)' in text and '3 outline' in text
