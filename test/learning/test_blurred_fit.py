"""What blur does to a response is measured in blurred pictures of the presses that it was learned from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from responding_gel import CONFIG, NOISE_PX, presses

from tactile_nodes import paths
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import Choice, DataConfig, ResponseConfig, TrainConfig
from tactile_nodes.learning.datasets.blurred_presses import BlurredPresses, simulate_blurred
from tactile_nodes.learning.datasets.simulated import Dataset, simulate
from tactile_nodes.learning.measured.blurred_fit import with_blurs
from tactile_nodes.learning.measured.fit import fit_response
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.source import simulated_data
from tactile_nodes.sensing.explain.measured.altered import read_altered
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.reading import Reading
from tactile_nodes.sensing.geometry import BinGrid

SHORT, FIRST = 0.05, 1200
How = Callable[[ResponseReadout, np.ndarray, np.ndarray], Reading]


def blurred(sharp: Dataset, seed: int) -> BlurredPresses:
    """Motion is short by a twentieth along x and by nothing along y, and has half of the noise more."""
    random = np.random.default_rng(seed)
    features = sharp.features.astype(float) * (1 - SHORT, 1.0)
    features += 0.5 * NOISE_PX * random.normal(size=features.shape)
    return BlurredPresses(0.52, 0.45, dataclasses.replace(sharp, features=features.astype(np.float16)))


@pytest.fixture(scope='module')
def sharp() -> ResponseReadout:
    data = presses(2000, seed=1)
    return fit_response(data, np.arange(2000) % 8 == 1, CONFIG, BinGrid(), Progress())


@pytest.fixture(scope='module')
def readout(sharp: ResponseReadout) -> ResponseReadout:
    data = presses(2000, seed=1)
    soft = blurred(data.take(np.arange(FIRST)), seed=5)
    return with_blurs(sharp, data, [soft], np.arange(2000) % 8 == 1, CONFIG, Progress())


def errors_n(of: ResponseReadout, fresh: Dataset, how: How = ResponseReadout.read) -> tuple[np.ndarray, np.ndarray]:
    """Of the forces of presses, and their stated standard deviations."""
    touched = np.flatnonzero(fresh.presses[:, 2] > 0)
    read = [how(of, fresh.features[i].astype(np.float32), fresh.confidence[0]) for i in touched]
    told = np.array([(each.normal_force_n.sum(), each.total_sigma_n) for each in read])
    return told[:, 0] - fresh.presses[touched, 3], told[:, 1]


def test_presses_in_blurred_pictures_are_read_nearly_as_well_as_in_sharp_ones(
    sharp: ResponseReadout, readout: ResponseReadout
) -> None:
    fresh = presses(400, seed=2)
    soft = blurred(fresh, seed=6)
    assert readout.blurs is not None
    knowing = readout.blurs.readout(readout, soft.sharpness)
    assert knowing is not None
    usual, short, mended = (
        np.sqrt(np.square(errors_n(*each)[0]).mean())
        for each in ((sharp, fresh), (sharp, soft.dataset), (knowing, soft.dataset))
    )
    assert short > 1.8 * usual  # 2.5 % of half a newton
    assert mended < 1.3 * usual  # by a noise of 1.12


def test_the_uncertainty_in_blurred_pictures_covers_the_errors_there(readout: ResponseReadout) -> None:
    """1.645 standard deviations cover 90 %; of 340 presses that share is known to 1.6 %, twice that for the limits."""
    soft = blurred(presses(400, seed=3), seed=7)
    assert readout.blurs is not None
    knowing = readout.blurs.readout(readout, soft.sharpness)
    assert knowing is not None
    errors, sigmas = errors_n(
        knowing, soft.dataset, partial(read_altered, measured=True)
    )  # as the live nodes read them
    assert 0.82 < np.mean(np.abs(errors) < 1.645 * sigmas) < 0.98


def test_sharp_pictures_are_read_by_the_numbers_that_were_there(
    sharp: ResponseReadout, readout: ResponseReadout
) -> None:
    for before, after in (
        (sharp.response.coefficients, readout.response.coefficients),
        (sharp.response.growth, readout.response.growth),
        (sharp.whitening, readout.whitening),
    ):
        np.testing.assert_array_equal(after, before)
    assert readout.calibration == sharp.calibration
    assert (readout.likeness.floor, readout.likeness.share) == (sharp.likeness.floor, sharp.likeness.share)


def test_too_few_presses_tell_nothing_of_blur(sharp: ResponseReadout) -> None:
    data = presses(2000, seed=1)
    soft = blurred(data.take(np.arange(100)), seed=5)
    assert with_blurs(sharp, data, [soft], np.zeros(2000, bool), CONFIG, Progress()).blurs is None
    assert with_blurs(sharp, data, [], np.zeros(2000, bool), CONFIG, Progress()).blurs is None


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrainConfig:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    return TrainConfig(
        readout='response',
        data=DataConfig(
            plan='jittered', presses=30, presses_per_rest_image=16, frames_per_rest_image=2, processes=1, split='sample'
        ),
        flow=Choice('inverse_compositional', {'rows': 10, 'cols': 10, 'finest_scale': 1}),
        encoding=Choice('cartesian_mean', {'rows': 10, 'cols': 10}),
        response=ResponseConfig(blur_px=(0.5, 1.0), blurred_presses=16),
    )


def test_blurred_presses_are_the_first_of_the_training_in_its_order(config: TrainConfig) -> None:
    """Of the first block all that are not put aside for the test; of motion blur takes a little."""
    data = simulated_data(config, Progress())
    weak, strong = data.blurred
    count = len(weak.dataset.presses)
    assert 8 <= count <= 16
    np.testing.assert_array_equal(weak.dataset.presses, data.dataset.presses[:count])
    np.testing.assert_array_equal(strong.dataset.presses, data.dataset.presses[:count])
    assert weak.sharp > weak.sharpness > strong.sharpness
    apart = np.abs(weak.dataset.features - data.dataset.features[:count]).max()
    assert 0 < apart < 0.2


def test_blurs_that_are_not_in_order_are_refused(config: TrainConfig) -> None:
    for wrong in ((1.0, 0.5), (0.0, 1.0), (-1.0,)):
        refused = dataclasses.replace(config, response=ResponseConfig(blur_px=wrong))
        with pytest.raises(ConfigurationError, match='each stronger than the one before'):
            simulate_blurred(refused, Progress())


def test_a_plan_of_another_length_is_another_data_set(config: TrainConfig) -> None:
    """Frames without contact stand elsewhere in it; a part of one must not be taken for the other."""
    shorter = dataclasses.replace(config, data=dataclasses.replace(config.data, presses=16, presses_per_rest_image=8))
    longer = dataclasses.replace(shorter, data=dataclasses.replace(shorter.data, presses=24))
    simulate(shorter, Progress())
    beside = simulate(longer, Progress())
    for file in paths.cache_directory().rglob('*.npz'):
        file.unlink()
    np.testing.assert_array_equal(beside.presses, simulate(longer, Progress()).presses)
