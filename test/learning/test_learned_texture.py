"""A training learns from its own pictures how far each spot of the gel goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_nodes.gel_tables import contact_table
from tactile_nodes.learning.config import Choice, DataConfig, ResponseConfig, TrainConfig
from tactile_nodes.learning.datasets.learned_texture import LEAST_PRESSES, RecordedTexture, simulated_texture
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.simulation.optics import Optics, Press, place_markers

SAMPLES = np.arange(100)
CONFIG = TrainConfig(
    readout='response',
    data=DataConfig(plan='random', presses=len(SAMPLES), frames_per_rest_image=4),
    flow=Choice('inverse_compositional', {'rows': 10, 'cols': 10, 'finest_scale': 1}),
    encoding=Choice('cartesian_mean', {'rows': 10, 'cols': 10}),
    response=ResponseConfig(texture_presses=80),
)


@pytest.fixture(scope='module')
def gains() -> np.ndarray:
    learned = simulated_texture(CONFIG, SAMPLES, Progress())
    assert learned is not None
    return learned.gains


def test_markers_near_the_skin_go_further_than_those_near_the_camera(gains: np.ndarray) -> None:
    """The soft layer is bonded to a rigid one at z = -6 mm and pressed from above, where its markers end at -1.5 mm."""
    gel = CONFIG.gel
    z_mm = place_markers(gel)[0][:, 2]
    places = np.rint(Optics(gel, contact_table(gel)).project(()) - [(640 - 440) / 2, (480 - 440) / 2]).astype(int)
    middle = (np.abs(places - 220) < 120).all(axis=1)
    near_skin, near_camera = (
        float(np.median(gains[tuple(places[middle & which].T[::-1])])) for which in (z_mm > -2.5, z_mm < -5.0)
    )
    assert near_skin > 0.1
    assert near_camera < -0.1


def test_what_would_not_use_it_learns_none() -> None:
    dense = replace(CONFIG, flow=Choice('dis', {}))
    network = replace(CONFIG, readout='network')
    none = replace(CONFIG, response=replace(CONFIG.response, texture_presses=0))
    assert all(simulated_texture(each, SAMPLES, Progress()) is None for each in (dense, network, none))


def test_the_same_training_learns_the_same(gains: np.ndarray) -> None:
    again = simulated_texture(CONFIG, SAMPLES, Progress())
    assert again is not None
    np.testing.assert_array_equal(again.gains, gains)


@pytest.fixture(scope='module')
def pictures() -> list[np.ndarray]:
    """The gel at rest, and then under one press after another."""
    optics = Optics(CONFIG.gel, contact_table(CONFIG.gel))
    presses = [Press(x, y, 1.2) for x, y in np.random.default_rng(2).uniform(-9, 9, (LEAST_PRESSES, 2)).tolist()]
    seen = [optics.render(each, number) for number, each in enumerate([(), *((each,) for each in presses)])]
    return [np.ascontiguousarray(centre_crop(each, 440, 440)) for each in seen]


def test_recorded_presses_tell_it_too_once_there_are_enough(pictures: list[np.ndarray], gains: np.ndarray) -> None:
    """Where both know enough of it, in the middle, they agree."""
    rest, *presses = pictures
    learned = RecordedTexture()
    for each in presses[:-1]:
        learned.take(rest, each)
    assert not learned.gains(rest).size
    learned.take(rest, presses[-1])
    middle = np.s_[140:300, 140:300]
    assert np.corrcoef(learned.gains(rest)[middle].ravel(), gains[middle].ravel())[0, 1] > 0.8


def test_presses_beside_a_rest_image_of_a_moved_camera_begin_anew(pictures: list[np.ndarray]) -> None:
    rest, *presses = pictures
    learned = RecordedTexture()
    for each in presses:
        learned.take(rest, each)
    learned.take(np.roll(rest, 2, axis=1), np.roll(presses[0], 2, axis=1))
    assert not learned.gains(rest).size
