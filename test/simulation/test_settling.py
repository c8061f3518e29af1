from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.settling import Settling

SECOND = 1_000_000_000


def pressed(table: ContactTable, *, hold_s: float) -> Settling:
    """A gel pressed to 1 mm in a microsecond and held; 20 % to settle, in 0.5 s."""
    gel = Settling(table, 0.2, 0.5, 0)
    gel.advance(1000, 1.0)
    gel.advance(round(hold_s * SECOND), 1.0)
    return gel


def test_a_sudden_press_takes_the_unsettled_force(table: ContactTable):
    sudden = Settling(table, 0.2, 0.5, 0).advance(1000, 1.0)
    assert sudden.force_n == pytest.approx(1.2 * table.force_at(1.0), rel=1e-4)


@pytest.mark.parametrize('hold_s', [0.1, 0.5, 2.0])
def test_a_held_press_settles_exponentially(table: ContactTable, hold_s: float):
    force = pressed(table, hold_s=hold_s).advance(round(hold_s * SECOND), 1.0).force_n
    assert force == pytest.approx((1 + 0.2 * math.exp(-hold_s / 0.5)) * table.force_at(1.0), rel=1e-4)


def test_holding_in_steps_or_at_once_is_the_same(table: ContactTable):
    gel = pressed(table, hold_s=0.001)
    for step in range(1, 100):
        gel.advance(SECOND // 1000 + step * SECOND // 99, 1.0)
    once = pressed(table, hold_s=0.001)
    end = SECOND // 1000 + SECOND
    assert gel.advance(end, 1.0).force_n == pytest.approx(once.advance(end, 1.0).force_n, rel=1e-9)


def test_a_slow_press_takes_the_settled_force(table: ContactTable):
    gel = Settling(table, 0.2, 0.5, 0)
    for second in range(1, 1001):
        last = gel.advance(second * SECOND, second / 1000)
    assert last.force_n == pytest.approx(table.force_at(1.0), rel=1e-3)


def test_a_tip_that_leaves_fast_leaves_a_dent_without_force(table: ContactTable):
    left = pressed(table, hold_s=5.0).advance(5 * SECOND + 1000, -1.0)
    assert left.force_n == 0
    assert table.force_at(left.depth_mm) == pytest.approx(0.2 / 1.2 * table.force_at(1.0), rel=1e-3)


def test_a_dent_heals_in_the_time_of_recovery(table: ContactTable):
    gel = pressed(table, hold_s=5.0)
    first = gel.advance(5 * SECOND + 1000, -1.0)
    for step in range(1, 1001):
        later = gel.advance(5 * SECOND + 1000 + step * SECOND // 1000, -1.0)
    healed = table.force_at(later.depth_mm) / table.force_at(first.depth_mm)
    assert healed == pytest.approx(math.exp(-1 / (0.5 * 1.2)), rel=5e-3)


def test_the_force_never_pulls(table: ContactTable):
    gel = pressed(table, hold_s=5.0)
    forces = [gel.advance(5 * SECOND + i * SECOND // 100, 1.0 - i / 20).force_n for i in range(1, 30)]
    assert min(forces) == 0
    assert np.all(np.diff(forces) <= 0)
