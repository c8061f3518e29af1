"""A table over the surface: linear between its entries, kept by a model file, and none in files of before."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_axisymmetric import readout

from tactile_nodes.sensing.explain.axisymmetric.correction import Correction, between

TABLE = np.array([[[0.0], [1.0]], [[2.0], [3.0]]])
"""1 for each half of the way to the right, 2 for each down."""


@pytest.mark.parametrize(
    ('place', 'expected'),
    [((-1.0, -1.0), 0.0), ((1.0, -1.0), 1.0), ((-1.0, 1.0), 2.0), ((0.0, 0.0), 1.5), ((0.5, -0.5), 0.75 + 0.5),
     ((7.0, -1.0), 1.0)],
)  # fmt: skip
def test_values_are_linear_between_entries_and_stay_as_at_the_border_beyond(
    place: tuple[float, float], expected: float
) -> None:
    assert between(TABLE, np.array([place])) == pytest.approx(np.array([[expected]]))


def local(x_mm: float, y_mm: float, share: float) -> Correction:
    return dataclasses.replace(readout().correction, local=np.tile([x_mm, y_mm, share], (3, 3, 1)))


def test_places_are_added_to_and_forces_grow_by_a_share() -> None:
    found = np.array([[1.0, -2.0, 0.5]])
    plain = dataclasses.replace(readout().correction, local=None)(found)
    more = local(0.1, -0.2, 0.04)(found)
    assert more == pytest.approx((plain + np.array([[0.1, -0.2, 0.0]])) * np.array([1.0, 1.0, 1.04]))
