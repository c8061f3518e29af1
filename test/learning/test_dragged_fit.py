"""What a drag adds to a response is measured in presses that were made once more with one."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from responding_gel import CONFIG as PLAIN
from responding_gel import NOISE_PX, motion, presses

from tactile_nodes.learning.config import Choice, DataConfig, ResponseConfig, TrainConfig
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.dragged_fit import with_drag
from tactile_nodes.learning.dragged_presses import DraggedPresses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.response_fit import fit_response
from tactile_nodes.learning.source import simulated_data
from tactile_nodes.sensing.contact_drag import Dragged
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensing.response_readout import ResponseReadout

FIRST, LONGEST_MM = 800, 1.0
CONFIG = dataclasses.replace(PLAIN, components=32)
HELD_OUT = np.arange(2000) % 8 == 1


def dragged(straight: Dataset, seed: int, longest_mm: float = LONGEST_MM) -> DraggedPresses:
    """Regions go with the tip, the more the nearer and the harder: 1 px for 1 mm and 1 N below it."""
    random = np.random.default_rng(seed)
    count = len(straight.presses)
    length, angle = random.uniform(0.05, 1.0, count) * longest_mm, random.uniform(0, 2 * np.pi, count)
    pull_mm = np.column_stack([length * np.cos(angle), length * np.sin(angle)])
    places, force = straight.presses[:, :2].astype(float), straight.presses[:, 3].astype(float)
    along = np.linspace(-11.0, 11.0, 6)
    away = np.stack(np.meshgrid(along, along), axis=-1)[None] - places[:, None, None]
    near = np.exp(-(away**2).sum(axis=-1, keepdims=True) / (2 * 4.0**2))
    field = motion(places, force) + 1.0 * (force[:, None] * pull_mm)[:, None, None] * near
    features = (field + NOISE_PX * random.normal(size=field.shape)).astype(np.float16)
    return DraggedPresses(dataclasses.replace(straight, features=features), pull_mm.astype(np.float32))


@pytest.fixture(scope='module')
def straight() -> ResponseReadout:
    return fit_response(presses(2000, seed=1), HELD_OUT, CONFIG, BinGrid(), Progress())


@pytest.fixture(scope='module')
def readout(straight: ResponseReadout) -> ResponseReadout:
    data = presses(2000, seed=1)
    return with_drag(straight, data, dragged(data.take(np.arange(FIRST)), seed=5), HELD_OUT, CONFIG, Progress())


def pressed_firmly(seed: int) -> DraggedPresses:
    """A quarter of a newton and more: lighter ones leave a drag of a few tenths of a millimetre in noise here."""
    fresh = dragged(presses(200, seed=seed, still=0.0), seed=seed + 4, longest_mm=0.5)
    return fresh.take(np.flatnonzero(fresh.dataset.presses[:, 3] > 0.25))


def test_drags_of_fresh_presses_are_found(readout: ResponseReadout) -> None:
    """Those of more than 0.2 mm, to a fifth of their length and 0.05 mm in nine of ten."""
    fresh, near = pressed_firmly(seed=2), []
    for features, pull_mm in zip(fresh.dataset.features, fresh.pull_mm, strict=True):
        seen = readout.seen(features.astype(np.float32), fresh.dataset.confidence[0])
        found, length_mm = readout.found(readout.whitening @ seen.scores), np.hypot(*pull_mm)
        if length_mm > 0.2:
            told = found.pull_mm if isinstance(found, Dragged) else np.zeros(2)
            near.append(np.hypot(*(told - pull_mm)) < 0.05 + 0.2 * length_mm)
    assert np.mean(near) >= 0.9


def test_where_a_drag_went_is_told_nearer_with_it_and_forces_within_what_is_stated(
    straight: ResponseReadout, readout: ResponseReadout
) -> None:
    """90 % within 1.645 standard deviations; of 150 presses that share is known to 2.5 %, three times that here."""
    fresh = pressed_firmly(seed=3)
    went = fresh.dataset.presses[:, :2] + fresh.pull_mm
    read = {
        name: [of.read(each.astype(np.float32), fresh.dataset.confidence[0]) for each in fresh.dataset.features]
        for name, of in (('without', straight), ('with', readout))
    }
    off = {
        name: [
            np.hypot(each.contacts[0].x_mm - x, each.contacts[0].y_mm - y)
            for each, (x, y) in zip(found, went.tolist(), strict=True)
        ]
        for name, found in read.items()
    }
    assert np.median(off['with']) < 0.4 * np.median(off['without'])
    errors_n = np.array([each.normal_force_n.sum() for each in read['with']]) - fresh.dataset.presses[:, 3]
    assert 0.82 < np.mean(np.abs(errors_n) < 1.645 * np.array([each.total_sigma_n for each in read['with']])) <= 1.0


def test_presses_straight_down_are_taken_for_such(straight: ResponseReadout, readout: ResponseReadout) -> None:
    """All but one of a thousand of those that judged; of two hundred others four would be chance of one in fifty."""
    fresh = presses(200, seed=4, still=0.0)
    same = [
        readout.read(*each).contacts == straight.read(*each).contacts
        for each in ((features.astype(np.float32), fresh.confidence[0]) for features in fresh.features)
    ]
    assert np.mean(same) >= 0.98


def test_too_few_presses_tell_nothing_of_drags(straight: ResponseReadout) -> None:
    data = presses(2000, seed=1)
    few = dragged(data.take(np.arange(100)), seed=5)
    assert with_drag(straight, data, few, HELD_OUT, CONFIG, Progress()).drag is None
    assert with_drag(straight, data, None, HELD_OUT, CONFIG, Progress()).drag is None


def test_dragged_presses_are_the_first_of_the_training_and_move_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    config = TrainConfig(
        readout='response',
        data=DataConfig(
            plan='jittered', presses=30, presses_per_rest_image=16, frames_per_rest_image=2, processes=1, split='sample'
        ),
        flow=Choice('inverse_compositional', {'rows': 10, 'cols': 10, 'finest_scale': 1}),
        encoding=Choice('cartesian_mean', {'rows': 10, 'cols': 10}),
        response=ResponseConfig(blurred_presses=0, texture_presses=0, dragged_presses=16, drag_mm=0.5),
    )
    data = simulated_data(config, Progress())
    assert data.dragged is not None
    count = len(data.dragged.pull_mm)
    assert 8 <= count <= 16
    np.testing.assert_array_equal(data.dragged.dataset.presses, data.dataset.presses[:count])
    touched = data.dataset.presses[:count, 2] > 0
    lengths = np.hypot(*data.dragged.pull_mm.T)
    assert (lengths[~touched] == 0).all()
    assert ((lengths[touched] >= 0.025) & (lengths[touched] <= 0.5)).all()
    longest = int(np.argmax(lengths))
    apart = (data.dragged.dataset.features - data.dataset.features[:count])[longest].astype(float).mean(axis=(0, 1))
    assert apart @ data.dragged.pull_mm[longest] > 0.9 * np.hypot(*apart) * lengths[longest]
