"""Two tips at once: which pairs are made, and when a pair counts as found."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.cli.main import main
from tactile_nodes.learning.config import DataConfig
from tactile_nodes.learning.evaluation.pairs import PairScores, judged, planned_pairs
from tactile_nodes.learning.evaluation.tables import pairs_table
from tactile_nodes.sensing.explain.model import ForceMap
from tactile_nodes.sensing.explain.reading import Contact

TIPS = np.array([[-4.0, 0.0, 1.0, 0.5], [4.0, 3.0, 0.5, 0.2]])


def found(*contacts: tuple[float, float, float], unlikeness: float = 0.3) -> ForceMap:
    total_n = float(sum(contact[2] for contact in contacts))
    return ForceMap(
        np.zeros((1, 1), np.float32), total_n, total_n, (0.0, 0.0), 1.0,
        tuple(Contact(*map(float, each)) for each in contacts), unlikeness=unlikeness,
    )  # fmt: skip


def test_a_pair_is_found_whichever_tip_is_the_stronger() -> None:
    for order in (1, -1):
        contacts = [(-4.5, 0.5, 0.55), (4.0, 3.9, 0.17)][::order]
        near, placed, counted, flagged, *_, off_n = judged(TIPS, found(*contacts), 0.05)
        assert (near, placed, counted, flagged) == (True, True, True, False)
        assert off_n == pytest.approx(0.02)


def test_a_force_off_by_more_than_a_fifth_is_not_found_but_placed() -> None:
    near, placed, *_ = judged(TIPS, found((-4, 0, 0.5), (4, 3, 0.245)), 0.05)
    assert (near, placed) == (False, True)


def test_both_contacts_at_one_tip_are_no_pair() -> None:
    near, placed, counted, *_ = judged(TIPS, found((-4, 0, 0.5), (-4, 0, 0.2)), 0.05)
    assert (near, placed, counted) == (False, False, True)


def test_contacts_below_the_threshold_do_not_count() -> None:
    near, placed, counted, *_ = judged(TIPS, found((-4, 0, 0.5), (4, 3, 0.2), (0, 9, 0.04)), 0.05)
    assert (near, placed, counted) == (True, True, True)
    near, placed, counted, *_ = judged(TIPS, found((-4, 0, 0.5), (4, 3, 0.2)), 0.3)
    assert (near, placed, counted) == (False, False, False)


def test_an_unlike_frame_is_flagged() -> None:
    assert judged(TIPS, found((0, 0, 0.6), unlikeness=1.2), 0.05)[3]


def test_a_total_beyond_its_interval_is_not_held() -> None:
    """1.645 standard deviations of 20 mN are 33 mN; the tips press with 0.7 N."""
    answer = dataclasses.replace(found((-4, 0, 0.52), (4, 3, 0.21)), total_sigma_n=0.02, nominal_n=0.02)
    assert judged(TIPS, answer, 0.05)[4:7] == (False, True, True)  # so close to each other they do not just add up
    answer = dataclasses.replace(answer, total_n=0.74)
    assert not judged(TIPS, answer, 0.05)[6]


def test_pairs_lie_within_the_reach_at_every_distance_alike() -> None:
    pairs = planned_pairs(DataConfig(seed=5, reach_mm=13.5), 2000)
    places = np.array([[(each.x_mm, each.y_mm) for each in pair] for pair in pairs])
    depths = np.array([[each.depth_mm for each in pair] for pair in pairs])
    distance = np.hypot(*(places[:, 1] - places[:, 0]).T)
    assert np.abs(places).max() <= 13.5
    assert depths.min() >= 0.3
    assert depths.max() <= 1.5
    # 400 are expected in each fifth; the binomial standard deviation is 18.
    assert np.abs(np.histogram(distance, [2.5, 5, 7.5, 10, 12.5, 15])[0] - 400).max() < 4 * 18
    assert planned_pairs(DataConfig(seed=5, reach_mm=13.5), 2000) == pairs


def test_the_table_has_a_row_for_each_distance() -> None:
    scores = PairScores(40, 0.95, 0.975, 1.0, 0.0, 0.05, 0.5, 0.4, 0.9, 0.0123)
    text = str(pairs_table({'all pairs': scores, '5 to 7.5 mm apart': dataclasses.replace(scores, pairs=7)}))
    cells = 'all pairs 40 95.0% 97.5% 100.0% 0.0% 5.0% 50.0% 40.0% 90.0% 0.0123'
    assert text.splitlines()[1].split() == cells.split()


def test_pairs_are_refused_beside_recorded_presses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['evaluate', 'any', '--pairs', '--dataset', 'some.npz']) != 0
    assert '--pairs simulate their own presses' in capsys.readouterr().err


@pytest.mark.parametrize('option', ['--presses', '--unlike', '--pairs'])
def test_more_presses_than_ever_end_are_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['evaluate', 'any', option, '9' * 20]) != 0
    assert 'no more than 1000000 presses' in capsys.readouterr().err
