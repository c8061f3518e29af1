"""What calibrations get wrong alike, by their number of presses, and how a model file keeps it."""

from __future__ import annotations

import numpy as np
import pytest
from test_axisymmetric import readout

from tactile_nodes.sensing.axisymmetric_carried import Carried
from tactile_nodes.sensing.readout_arrays import readout_arrays, readout_from

TERMS = np.stack([np.full((20, 3), 3.0), np.full((20, 3), 1.0)])
CARRIED = Carried((10, 40), TERMS)
TABLES = np.stack([np.full((5, 5, 3), 0.03), np.full((5, 5, 3), 0.01)])


@pytest.mark.parametrize(('presses', 'expected'), [(3, 3.0), (10, 3.0), (20, 2.0), (40, 1.0), (400, 1.0)])
def test_terms_follow_the_logarithm_of_the_presses(presses: int, expected: float) -> None:
    assert CARRIED.after(presses) == pytest.approx(np.full((20, 3), expected))


def test_terms_after_one_number_of_presses_serve_for_all() -> None:
    once = Carried((25,), TERMS[:1])
    assert once.after(5) == pytest.approx(TERMS[0])
    assert once.after(100) == pytest.approx(TERMS[0])


def test_tables_follow_the_logarithm_of_the_presses_too() -> None:
    table = Carried((10, 40), TERMS, TABLES).local_after(20)
    assert table == pytest.approx(np.full((5, 5, 3), 0.02))


def test_it_comes_back_from_a_file() -> None:
    whole = readout(carried=CARRIED)
    again = readout_from(*readout_arrays(whole), whole.bins).carried
    assert again is not None
    assert again.presses == CARRIED.presses
    assert again.terms == pytest.approx(TERMS)
    assert again.local is None


def test_its_tables_come_back_from_a_file_to_a_thousandth() -> None:
    whole = readout(carried=Carried((10, 40), TERMS, TABLES))
    again = readout_from(*readout_arrays(whole), whole.bins).carried
    assert again is not None
    assert again.local == pytest.approx(TABLES, rel=1e-3)


def test_a_file_without_it_carries_nothing() -> None:
    arrays, said = readout_arrays(readout())
    assert 'carried' not in arrays
    assert readout_from(arrays, said, readout().bins).carried is None
