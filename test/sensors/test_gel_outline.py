"""Rims of gels: what they hold."""

import math

import numpy as np
import pytest

from tactile_nodes.sensors import Outline

HEXAGON = '-6,-10 6,-10 12,0 6,10 -6,10 -12,0'


def test_an_ellipse_holds_what_its_equation_holds() -> None:
    """(6, 4) in half axes of 10 and 5: 0.36 + 0.64 = 1, the rim; a little further out it is beside."""
    rim = Outline(20.0, 10.0, 'ellipse')
    assert rim.holds(np.array([[5.99, 3.99], [6.01, 4.01], [9.9, 0.0], [9.9, 4.9]])).tolist() == [
        True,
        False,
        True,
        False,
    ]


def test_a_polygon_holds_what_lies_within_its_edges() -> None:
    """On the height y = 5 the hexagon's right edge from (12, 0) to (6, 10) is at x = 9."""
    rim = Outline(24.0, 20.0, HEXAGON)
    assert rim.holds(np.array([[8.99, 5.0], [9.01, 5.0], [-8.99, -5.0], [-9.01, -5.0]])).tolist() == [True, False] * 2


def test_a_polygon_with_a_bay_does_not_hold_the_bay() -> None:
    rim = Outline(20.0, 20.0, '-10,-10 10,-10 10,10 3,10 3,2 -3,2 -3,10 -10,10')
    assert rim.holds(np.array([[0.0, 5.0], [0.0, 1.0], [5.0, 5.0]])).tolist() == [False, True, True]


def test_the_share_of_a_rectangle_that_is_its_ellipse_is_a_quarter_of_pi() -> None:
    places = np.random.default_rng(1).uniform((-10.0, -5.0), (10.0, 5.0), (100_000, 2))
    assert Outline(20.0, 10.0, 'ellipse').holds(places).mean() == pytest.approx(math.pi / 4, abs=0.005)
    assert Outline(20.0, 10.0).holds(places).all()


def test_the_largest_square_in_a_circle_has_its_corners_on_the_rim() -> None:
    assert Outline(20.0, 20.0, 'ellipse').inner_mm == pytest.approx(10 / math.sqrt(2), rel=1e-3)
    assert Outline(24.0, 20.0).inner_mm == 10.0


def test_a_lattice_covers_what_is_gel() -> None:
    """Every 2 mm through (2.5, 0) on 6x4 mm: to x = -1.5 and to both rims along y. An ellipse holds a row of it."""
    x, y = np.meshgrid([-1.5, 0.5, 2.5], [-2.0, 0.0, 2.0])
    lattice = np.column_stack([x.ravel(), y.ravel()])
    assert Outline(6.0, 4.0).lattice_mm(2.0, (2.5, 0.0)) == pytest.approx(lattice)
    assert Outline(6.0, 4.0, 'ellipse').lattice_mm(2.0, (2.5, 0.0)) == pytest.approx(lattice[3:6])
