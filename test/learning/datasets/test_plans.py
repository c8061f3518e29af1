from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import DataConfig, TrainConfig
from tactile_nodes.learning.datasets.plans import grid_plan, planned_presses, press_count, press_numbers, spread_plan
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.source import simulated_split
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.gel import Gel


def paper(**options: object) -> DataConfig:
    return DataConfig(**{'plan': 'paper', 'without_contact': 0.0, **options})  # type: ignore[arg-type]


def as_samples(plan: np.ndarray) -> Dataset:
    presses = np.column_stack([plan, np.maximum(plan[:, 2], 0)]).astype(np.float32)
    return Dataset(
        np.zeros((len(plan), 1, 1, 2), np.float16), presses, np.zeros(len(plan), int), np.ones((1, 1, 1)), ''
    )


def test_the_papers_plan_has_its_presses():
    plan = grid_plan(paper())
    assert len(plan) == press_count(paper()) == 10952
    assert len(np.unique(plan, axis=0)) == 10952
    assert np.unique(plan[:, 0]).tolist() == np.unique(plan[:, 1]).tolist()
    np.testing.assert_allclose(np.unique(plan[:, 0]), np.arange(-13.5, 13.51, 0.75))
    np.testing.assert_allclose(np.unique(plan[:, 2]), np.arange(1, 9) / 4)


def test_the_coarse_plan_is_800_presses_at_every_fourth_of_the_papers_places():
    plan = grid_plan(paper(plan='coarse'))
    assert len(plan) == press_count(paper(plan='coarse')) == 800
    np.testing.assert_allclose(np.unique(plan[:, 0]), np.arange(-13.5, 13.51, 3.0))
    assert {tuple(press) for press in plan.tolist()} <= {tuple(press) for press in grid_plan(paper()).tolist()}


def test_a_spread_plan_is_2000_presses_at_most():
    """As many places as it is chosen from."""
    plan = spread_plan(paper(plan='spread'))
    assert len(plan) == press_count(paper(plan='spread')) == 2000


def test_the_papers_plan_is_split_into_the_papers_numbers_whatever_frames_are_without_contact():
    plan = grid_plan(paper(without_contact=0.05))
    split = simulated_split(as_samples(plan), paper(without_contact=0.05), 0.1)
    touched = plan[:, 2] > 0
    assert (~touched).sum() == 576  # a twentieth of 11528
    assert [int(touched[part].sum()) for part in (split.train, split.validation, split.test)] == [7884, 877, 2191]


def test_a_jittered_plan_stays_within_each_cell_and_step():
    """Same seed, same order: every press lies within half a pitch and half a step of the paper's nearest one."""
    moved = grid_plan(paper(plan='jittered'))
    away = np.abs(moved - np.round((moved + 13.5) / 0.75) * 0.75 + 13.5)[:, :2]
    assert away.max() <= 0.375
    depth = np.round(moved[:, 2] / 0.25)
    assert np.abs(moved[:, 2] - 0.25 * depth).max() <= 0.125 + 1e-12
    cells = np.column_stack([np.round((moved[:, :2] + 13.5) / 0.75), np.clip(depth, 1, 8)])
    assert len(np.unique(cells, axis=0)) > 10900  # a press exactly between two steps may round to either
    assert len(np.unique(moved[:, 0])) == 10952


def test_the_first_part_of_a_grid_covers_the_gel():
    part = grid_plan(paper(presses=500))
    assert len(part) == 500
    assert len({BinGrid().bin_of(*place) for place in part[:, :2].tolist()}) > 75  # of 81 bins


def test_blocks_of_a_grid_follow_each_other():
    data = paper(presses=10)
    plan = grid_plan(data)
    presses = [*planned_presses(data, 0, 0, 6), *planned_presses(data, 1, 6, 4)]
    assert [(each.x_mm, each.y_mm, each.depth_mm) for each in presses] == [tuple(each) for each in plan.tolist()]


def test_a_frame_without_contact_belongs_to_the_press_after_it():
    assert press_numbers(np.array([1.0, -1.0, 0.5, -1.0, -1.0, 2.0])).tolist() == [0, 1, 1, 2, 2, 2]


def test_by_position_no_place_of_the_test_is_trained():
    data = paper(split='position')
    plan = grid_plan(data)
    split = simulated_split(as_samples(plan), data, 0.1)
    places = [{tuple(each) for each in plan[part, :2].tolist()} for part in (split.train, split.validation, split.test)]
    assert [len(each) for each in places] == [985, 110, 274]
    assert not places[0] & places[2]
    assert not places[1] & (places[0] | places[2])


@pytest.mark.parametrize('seed', [1, 2])
def test_random_presses_lie_within_the_limits(seed: int):
    presses = planned_presses(DataConfig(seed=seed, reach_mm=3.0, deepest_mm=1.0), 4, 0, 200)
    depths = np.array([each.depth_mm for each in presses])
    assert max(abs(each.x_mm) for each in presses) <= 3.0
    assert set(depths[depths < 0]) == {-1.0}
    assert depths.max() <= 1.0


def test_a_spread_plan_down_to_no_depth_has_no_press_of_none():
    """One of its 300 presses is less than half a micrometre deep, and would be rounded to 0, which no plan may have."""
    depths_mm = spread_plan(DataConfig(plan='spread', presses=300, seed=7, without_contact=0.0))[:, 2]
    assert len(depths_mm) == 300
    assert depths_mm.min() > 0


def test_limits_of_the_depth_may_be_given_in_either_order():
    shallow, deep = (
        [press.depth_mm for press in planned_presses(DataConfig(shallowest_mm=a, deepest_mm=b), 0, 0, 20)]
        for a, b in ((0.5, 1.0), (1.0, 0.5))
    )
    assert shallow == deep


def test_presses_beside_a_small_gel_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    data = DataConfig(presses=20, processes=1, frames_per_rest_image=1)
    with pytest.raises(ConfigurationError, match='presses beside the gel; use the plan random or spread'):
        simulate(TrainConfig(data=data, gel=Gel(size_mm=20.0)), Progress())
