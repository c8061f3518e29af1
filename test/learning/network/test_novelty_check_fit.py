"""The novelty check that training gives a network: it finds the force of one contact, and knows two from one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from responding_gel import CONFIG, motion, presses
from told import Told

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.network.novelty_check_fit import config_for, with_novelty_check
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.network import InputScaling, Mlp, NetworkReadout, TotalSpread
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid()
SHAPE = (6, 6, 2)
SURE = np.ones(SHAPE[:2], np.float32)
NETWORK = NetworkReadout(
    InputScaling(np.zeros(SHAPE, np.float32), np.ones(SHAPE, np.float32), SURE),
    Mlp((np.zeros((BINS.count, 72), np.float32),), (np.zeros(BINS.count, np.float32),)),
    BINS,
    spread=TotalSpread(0.03, 0.08),
)


def polar(field: np.ndarray) -> np.ndarray:
    """Magnitude, and angle from 0 to 2 pi."""
    x, y = np.moveaxis(field, -1, 0)
    return np.stack([np.hypot(x, y), np.arctan2(y, x) % (2 * np.pi)], axis=-1).astype(np.float32)


def of_contacts(*contacts: tuple[float, float, float]) -> np.ndarray:
    """What contacts (x, y, N) cause together."""
    return sum(motion(np.array([each[:2]]), np.array(each[2:]))[0] for each in contacts)  # type: ignore[return-value]


def made(data: Dataset, encoding: str, progress: Progress) -> NetworkReadout:
    return with_novelty_check(NETWORK, data, np.zeros(len(data.presses), bool), encoding, progress, CONFIG)


def test_a_novelty_check_of_polar_features_finds_force_and_place_of_one_contact_and_is_not_content_with_two():
    data, progress = presses(700, 1), Told()
    novelty_check = made(replace(data, features=polar(data.features)), 'polar_mean', progress).novelty_check
    one = novelty_check.read(polar(of_contacts((3.0, -2.0, 0.4))), SURE)
    contact = one.contacts[0]
    assert abs(contact.force_n - 0.4) < 0.02
    assert np.hypot(contact.x_mm - 3, contact.y_mm + 2) < 0.1
    assert one.unlikeness < 1
    assert novelty_check.read(polar(of_contacts((-5.0, -2.0, 0.4), (5.0, 0.0, 0.3))), SURE).unlikeness > 2
    assert progress.lines == []


@pytest.mark.parametrize(('count', 'apart_mm'), [(10952, 2.0), (392, 27 / 7)])
def test_splines_lie_as_close_as_presses_can_tell(count: int, apart_mm: float):
    """392 presses are eight at each of 7 x 7 places, 27 / 7 mm apart."""
    random = np.random.default_rng(0)
    rows = np.column_stack([random.uniform(-13.5, 13.5, (count, 2)), np.ones((count, 2))]).astype(np.float32)
    rows[0, :2], rows[1, :2] = -13.5, 13.5
    assert config_for(rows).spacing_mm == pytest.approx(apart_mm)


def test_presses_without_the_untouched_gel_give_no_novelty_check_and_say_so():
    data, progress = presses(300, 1, still=0.0), Told()
    assert made(data, 'cartesian_mean', progress).novelty_check is None
    assert 'no novelty check' in progress.lines[0]
    assert '12 images of the untouched gel' in progress.lines[0]


def test_who_does_not_wait_for_the_novelty_check_keeps_the_network():
    progress = Told(ctrl_c_at=1)
    assert made(presses(700, 1), 'cartesian_mean', progress).novelty_check is None
    assert progress.lines[0].endswith('stopped')
