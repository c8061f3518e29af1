"""Tuning: the front, the wish, and what is tried."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from press_bags import Collection, Sensor
from responding_gel import CONFIG, presses

from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.learning.config import Choice, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import BuildOptions
from tactile_nodes.learning.training.source import TrainingData
from tactile_nodes.learning.tuning.search import (
    IMAGES,
    Candidate,
    RecordedSource,
    SimulatedSource,
    Wish,
    candidates,
    chosen_place,
    said_of,
    table_of,
    tune,
)
from tactile_nodes.learning.tuning.times import cpu_times_ms
from tactile_nodes.sensing.metrics import pareto_front

numbers = st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)), min_size=1, max_size=20)


def test_the_front_holds_what_no_other_beats_and_nothing_that_is_no_number() -> None:
    assert pareto_front([1.0, 2.0, 3.0, 3.0, 0.5, 0.1], [5.0, 6.0, 4.0, 7.0, 9.0, float('nan')]) == [4, 0, 2]


@given(numbers)
def test_whatever_is_not_on_the_front_is_beaten_by_one_that_is(points: list[tuple[float, float]]) -> None:
    front = pareto_front(*zip(*points, strict=True))
    for cost, error in points:
        assert any(points[i][0] <= cost and points[i][1] <= error for i in front)
    assert all(points[a][1] > points[b][1] for a, b in itertools.pairwise(front))


def made(name: str, ms: float, error: float) -> Any:
    tried = SimpleNamespace(candidate=SimpleNamespace(name=name), ms=ms)
    tried.error = lambda metric: error
    return tried


FRONT = [made('small', 0.5, 0.02), made('middle', 1.0, 0.01), made('large', 4.0, 0.004)]


@pytest.mark.parametrize(
    ('wish', 'place'),
    [
        (Wish(max_error=0.01), 1),
        (Wish(max_error=0.5), 0),
        (Wish(max_ms=3.9), 1),
        (Wish(max_ms=100.0), 2),
        (Wish(max_error=0.005, max_ms=5.0), 2),
    ],
)
def test_the_wish_takes_the_cheapest_that_is_good_or_the_best_that_is_fast(wish: Wish, place: int) -> None:
    assert chosen_place(FRONT, wish) == place


@pytest.mark.parametrize(
    ('wish', 'closest'),
    [(Wish(max_error=0.001), 'large'), (Wish(max_ms=0.1), 'small'), (Wish(max_error=0.01, max_ms=0.8), 'middle')],
)
def test_a_wish_that_none_meets_names_the_closest(wish: Wish, closest: str) -> None:
    with pytest.raises(ConfigurationError, match=f'the closest is {closest}'):
        chosen_place(FRONT, wish)


@pytest.mark.parametrize('options', [{}, {'max_ms': 0.0}, {'max_error': -1.0}, {'max_ms': 1.0, 'metric': 'beauty'}])
def test_a_wish_that_is_none_is_one_sentence(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        Wish(**options)


def test_candidates_have_names_of_their_own_and_methods_that_exist() -> None:
    every = candidates()
    assert len({each.name for each in every}) == len(every)
    for each in every:
        config = each.of(TrainConfig())
        assert config.make_encoding().options['rows'] == each.regions
        assert config.make_flow().options


def test_a_data_set_cannot_be_tuned_with() -> None:
    with pytest.raises(ConfigurationError, match='not images'):
        SimulatedSource(TrainConfig(data=DataConfig(file='presses.npz')))


@dataclass
class Measured(SimulatedSource):
    """Features of a gel whose motion is known, the noisier the fewer components a candidate has."""

    dataset: Dataset

    def data(self, candidate: Candidate, progress: Progress) -> TrainingData:
        noise = 0.3 / candidate.components * np.random.default_rng(5).normal(size=self.dataset.features.shape)
        noisy = replace(self.dataset, features=(self.dataset.features + noise).astype(np.float16))
        config = TrainConfig(
            readout='response', flow=candidate.flow, encoding=Choice('cartesian_mean', {'rows': 6, 'cols': 6}),
            response=replace(CONFIG, components=candidate.components), data=DataConfig(crop=96),
        )  # fmt: skip
        return TrainingData(config, noisy, np.arange(len(noisy.presses)) % 5 == 1, {'id': 'known'}, {})

    def images(self) -> list[np.ndarray]:
        rest = np.random.default_rng(1).integers(20, 200, (96, 96), dtype=np.uint8)
        return [rest, np.roll(rest, 1, axis=1), np.roll(rest, 2, axis=0)]


def test_tuning_tries_all_and_says_what_the_next_smaller_one_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    # Times that are given, because those of a busy machine say little of two configurations.
    monkeypatch.setattr('tactile_nodes.learning.tuning.search.cpu_times_ms', lambda *_: [1.0, 10.0])
    patches = {'rows': 6, 'cols': 6}
    slow = Choice('dis', {'preset': 'medium', 'finest_scale': 0, 'gradient_descent_iterations': 200})
    among = [
        Candidate('cheap', Choice('inverse_compositional', {**patches, 'finest_scale': 1}), 6, 8),
        Candidate('dear', slow, 6, 16),
    ]
    tuned = tune(Measured(presses(250, seed=1)), Wish(max_ms=1e6), Progress(), 'tactile tune', among)
    assert [each.candidate.name for each in tuned.front] == ['cheap', 'dear']
    assert tuned.chosen.candidate.name == 'dear'
    assert tuned.smaller is tuned.front[0]
    assert tuned.chosen.card['flow']['name'] == 'dis'
    said = said_of(tuned, 'armse_n')
    assert said.startswith('dear: armse_n 0.')
    assert 'The next smaller one, cheap,' in said
    table = table_of(tuned)
    assert [(row[0], row[-1]) for row in table.rows] == [('cheap', 'front'), ('dear', 'chosen')]
    assert len(table.heads) == len(table.rows[0])
    none = replace(tuned, wish=Wish(max_ms=0.5))  # the table shows what each would have cost
    assert [row[-1] for row in table_of(none).rows] == ['front', 'front']
    with pytest.raises(ConfigurationError, match='the closest is cheap'):
        assert none.chosen


def test_images_to_measure_times_with_come_from_any_of_the_bags(tmp_path: Path) -> None:
    """A run that ended before its first press leaves a bag without."""
    ended, pressed = Collection(tmp_path / 'ended', Sensor()), Collection(tmp_path / 'pressed', Sensor())
    pressed.reference(0)
    pressed.press(0, 1, 0.0, 0.0, 0.5)
    found = RecordedSource([ended.close(), pressed.close()], BuildOptions(), TrainConfig()).images()
    assert len(found) == 2


def test_only_the_bags_whose_images_are_needed_are_opened(tmp_path: Path) -> None:
    pressed = Collection(tmp_path / 'pressed', Sensor())
    for slot in range(IMAGES):
        pressed.reference(slot)
        pressed.press(slot, slot + 1, 0.0, 0.0, 0.5)
    found = RecordedSource([pressed.close(), tmp_path / 'no_bag'], BuildOptions(), TrainConfig()).images()
    assert len(found) == IMAGES + 1


def test_times_need_an_image_of_a_press() -> None:
    with pytest.raises(DatasetError, match='no image of a press'):
        cpu_times_ms([], [np.zeros((96, 96), np.uint8)], Progress())
