"""What calibrations get wrong alike, by their number of presses, and how a model file keeps it."""

from __future__ import annotations

import numpy as np
import pytest
from test_axisymmetric import readout

from tactile_nodes.sensing.explain.arrays import readout_arrays, readout_from
from tactile_nodes.sensing.explain.axisymmetric.prior import ErrorPrior

TERMS = np.stack([np.full((20, 3), 3.0), np.full((20, 3), 1.0)])
PRIOR = ErrorPrior((10, 40), TERMS)


@pytest.mark.parametrize(('presses', 'expected'), [(3, 3.0), (10, 3.0), (20, 2.0), (40, 1.0), (400, 1.0)])
def test_terms_follow_the_logarithm_of_the_presses(presses: int, expected: float) -> None:
    assert PRIOR.after(presses) == pytest.approx(np.full((20, 3), expected))


def test_terms_after_one_number_of_presses_serve_for_all() -> None:
    once = ErrorPrior((25,), TERMS[:1])
    assert once.after(5) == pytest.approx(TERMS[0])
    assert once.after(100) == pytest.approx(TERMS[0])


def test_a_table_beside_it_in_a_file_of_before_is_left_aside() -> None:
    whole = readout(prior=PRIOR)
    arrays, entries = readout_arrays(whole)
    again = readout_from({**arrays, 'carried_local': np.ones((2, 5, 5, 3), np.float16)}, entries, whole.bins)
    assert again.prior.after(10) == pytest.approx(TERMS[0])
    assert again.correction.local is None
