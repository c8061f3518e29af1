"""What calibrations for several gels get wrong alike is found, and the next one begins without it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from responding_gel import REACH_MM, motion, seen_with_noise

from tactile_nodes.learning.config import AxisymmetricConfig, DataConfig, TrainConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.training.train import with_prior
from tactile_nodes.learning.transfer.fit import OtherGel
from tactile_nodes.learning.transfer.prior import found_by_counts, learned_prior
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout

SOFTER = 1.25
SHARE = 0.06


def pressed(count: int, seed: int, share: float = 0.0) -> Dataset:
    """Presses on a softer gel, of which the forces are stated larger by a share."""
    random = np.random.default_rng(seed)
    places = random.uniform(1 - REACH_MM, REACH_MM - 1, (count, 2))
    force = np.where(np.arange(count) < count - 20, random.uniform(0.1, 0.75, count), 0.0)
    return seen_with_noise(motion(places, SOFTER * force), places, (1 + share) * force, random)


def test_a_share_of_the_force_that_all_calibrations_lack_is_found(known_gel: AxisymmetricReadout) -> None:
    """Calibrated by forces as they are and judged by forces 6 % larger, forces come out 6 % too small everywhere."""
    gels = [found_by_counts(known_gel, pressed(60, seed), pressed(120, seed + 10, SHARE), (30,)) for seed in (1, 2)]
    terms = learned_prior(known_gel, gels, counts=(30,)).after(30)
    correction = dataclasses.replace(known_gel.correction, terms=terms)
    asked = np.array([[0.0, 0.0, 0.3], [4.0, -4.0, 0.5], [-3.0, 5.0, 0.6]])
    assert correction(asked)[:, 2] / asked[:, 2] - 1 == pytest.approx(SHARE, abs=0.02)


def test_a_calibration_begins_with_the_prior_and_hands_none_on(known_gel: AxisymmetricReadout) -> None:
    terms = np.stack([np.full_like(known_gel.correction.terms, each) for each in (0.3, 0.1)])
    other = OtherGel.of(dataclasses.replace(known_gel, prior=ErrorPrior((10, 40), terms)), pressed(40, seed=3))
    readout = other.readout(other.start, known_gel.doubt)
    assert readout.correction.terms == pytest.approx(np.full_like(terms[0], 0.2))
    assert readout.prior is None


def test_a_gel_that_differs_as_a_whole_only_takes_the_correction_of_places(known_gel: AxisymmetricReadout) -> None:
    """The prior was measured on gels whose every region was found."""
    own = np.random.default_rng(1).normal(size=known_gel.correction.terms.shape)
    known = dataclasses.replace(
        known_gel,
        correction=Correction(own, known_gel.correction.reach_mm, known_gel.correction.hardest_n),
        prior=ErrorPrior((10,), np.ones((1, *own.shape))),
    )
    other = OtherGel.of(known, pressed(40, seed=3))
    correction = other.readout(other.start, known_gel.doubt, 'whole').correction
    assert correction.terms[:, :2] == pytest.approx(own[:, :2])
    assert not correction.terms[:, 2].any()
    assert correction.local is None


def test_a_gel_of_recorded_presses_learns_nothing_from_others(known_gel: AxisymmetricReadout) -> None:
    recorded = TrainConfig(data=DataConfig(file='presses.npz'), axisymmetric=AxisymmetricConfig(other_gels=3))
    assert with_prior(known_gel, recorded, Progress()) is known_gel
