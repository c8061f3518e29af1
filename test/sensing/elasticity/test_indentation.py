"""Rigid bodies on a layer, against what theory says of balls and punches."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.indentation import Indenter
from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.sensing.elasticity.stack import Elastic

MODULUS_MPA = 0.111
EVERYWHERE = np.array([0.0])


def surface(thickness_mm: float = 6.0, spacing_mm: float = 0.2) -> ElasticLayer:
    return ElasticLayer([Elastic(thickness_mm, MODULUS_MPA)], EVERYWHERE, (spacing_mm, spacing_mm))


def ball(layer: ElasticLayer, radius_mm: float) -> np.ndarray:
    away = np.hypot(*np.moveaxis(layer.nodes_mm, -1, 0))
    inside = np.square(away) < radius_mm**2
    return np.where(inside, radius_mm - np.sqrt(np.where(inside, radius_mm**2 - away**2, 0.0)), np.inf)


def test_a_ball_on_a_thin_layer_bears_what_dimitriadis_found() -> None:
    """Incompressible, bonded (Dimitriadis et al. 2002, eq. 13); at chi = 0.36 that is 1.67 times Hertz's force."""
    layer, radius_mm = surface(), 5.0
    deep = Indenter(layer, ball(layer, radius_mm)).pressed(2.0).depth_mm
    chi = np.sqrt(radius_mm * deep) / 6.0
    thin = 1 + 1.133 * chi + 1.283 * chi**2 + 0.769 * chi**3 + 0.0975 * chi**4
    assert 16 / 3 * MODULUS_MPA * np.sqrt(radius_mm) * deep**1.5 * thin == pytest.approx(2.0, rel=0.02)


def test_a_ball_touches_over_hertzs_disc_with_hertzs_pressure() -> None:
    """a³ = 3 F R / (16 G), and p = 3 F / (2 pi a²) sqrt(1 - r² / a²)."""
    layer, radius_mm, force_n = surface(12.0, 0.1), 4.0, 0.05
    found = Indenter(layer, ball(layer, radius_mm)).pressed(force_n)
    a = np.cbrt(3 * force_n * radius_mm / (16 * MODULUS_MPA))
    away = np.hypot(*found.place_mm.T)
    assert away.max() == pytest.approx(a, abs=0.1)
    highest = 1.5 * force_n / (np.pi * a**2)
    inner = away < 0.8 * a
    theory = highest * np.sqrt(1 - np.square(away[inner] / a))
    assert found.force_n[inner] / 0.1**2 == pytest.approx(theory, rel=0.06)


def test_a_flat_punch_presses_hardest_at_its_rim() -> None:
    """p = F / (2 pi a sqrt(a² - r²)): in the middle half of what it is on average."""
    step_mm = 1 / 6
    layer = surface(16.0, step_mm)
    away = np.hypot(*np.moveaxis(layer.nodes_mm, -1, 0))
    found = Indenter(layer, np.where(away <= 1.0, 0.0, np.inf)).pressed(0.2)
    pressure, from_middle = found.force_n / step_mm**2, np.hypot(*found.place_mm.T)
    average = 0.2 / np.pi
    assert pressure[from_middle < 1 / 3].mean() == pytest.approx(average / 2, rel=0.05)
    assert pressure[from_middle > 0.93].min() > 1.5 * average
    assert found.depth_mm == pytest.approx(0.2 / (8 * MODULUS_MPA), rel=0.1)  # F = 8 G a d in a half-space


def test_what_rests_on_two_feet_of_different_height_bears_on_the_lower_one_first() -> None:
    layer = surface()
    x, y = np.moveaxis(layer.nodes_mm, -1, 0)
    feet = np.where(np.hypot(x - 4, y) < 1.1, 0.0, np.where(np.hypot(x + 4, y) < 1.1, 0.2, np.inf))
    body = Indenter(layer, feet)
    light, heavy = body.pressed(0.02), body.pressed(2.0)
    assert (light.place_mm[:, 0] > 0).all()
    assert light.centre_mm == pytest.approx([4.0, 0.0], abs=0.01)
    assert 0.0 < heavy.centre_mm[0] < 2.0
    assert heavy.force_n.sum() == pytest.approx(2.0)
