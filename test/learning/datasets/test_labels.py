"""Labels: the reading of the bins, and where a press on a border belongs."""

from __future__ import annotations

import numpy as np

from tactile_nodes.learning.datasets.labels import bin_indices, force_labels, outside
from tactile_nodes.sensing.geometry import BinGrid

WHOLE = BinGrid(9, 9, 32.0, 32.0)
PRESSED = BinGrid(9, 9, 27.0, 27.0)


def test_bins_of_the_whole_surface_are_counted_from_its_corner() -> None:
    places = np.array([[0.0, 0.0], [-16.0, -16.0], [15.9, -16.0], [-13.5, 13.5]])
    assert bin_indices(places, WHOLE).tolist() == [40, 0, 8, 72]


def test_a_centre_on_a_border_belongs_to_the_bin_towards_x_and_y() -> None:
    """Over 27 mm the borders lie at 1.5, 4.5, … mm: column (1.5 + 13.5) / 3 = 5, row (-7.5 + 13.5) / 3 = 2."""
    assert bin_indices(np.array([[1.5, -7.5]]), PRESSED).tolist() == [2 * 9 + 5]


def test_binary_dust_does_not_move_a_press_over_a_border() -> None:
    dust = 1e-9
    places = np.array([[1.5 - dust, -7.5 - dust], [1.5 + dust, -7.5 + dust]])
    assert bin_indices(places, PRESSED).tolist() == [23, 23]


def test_borders_that_no_decimal_meets_are_not_moved() -> None:
    """16/9 mm is the border right of the middle bin; a micrometre before it is in the middle bin."""
    assert bin_indices(np.array([[16 / 9 - 1e-3, 0.0], [16 / 9 + 1e-3, 0.0]]), WHOLE).tolist() == [40, 41]


def test_a_label_holds_the_whole_force_in_one_bin() -> None:
    labels = force_labels(np.array([[0.0, 0.0], [-16.0, -16.0]]), np.array([0.5, 0.25]), WHOLE)
    assert labels.shape == (2, 81)
    assert (labels[0, 40], labels[1, 0], labels.sum()) == (0.5, 0.25, 0.75)


def test_the_rim_belongs_to_the_surface() -> None:
    assert not outside(13.5, -13.5, PRESSED)
    assert outside(13.6, 0.0, PRESSED)
