"""Waves of load on a layered gel against what theory says of a half-space, a bonded layer and a deck of cards."""

import numpy as np
import pytest

from tactile_nodes.sensing.elasticity.stack import Elastic, waves_in
from tactile_nodes.simulation.mechanics import Layer

MODULUS_MPA, THICK_MM = 0.111, 6.0
GEL = [Elastic(THICK_MM, MODULUS_MPA)]


def test_a_short_wave_sinks_into_a_half_space() -> None:
    """Johnson, Contact Mechanics, 3: it sinks by exp(-kz) (2 (1 - nu) + kz) / (2 G k), so (1 - nu) / (G k) on top."""
    k, depths = np.array([2.0, 4.0]), np.array([0.0, 0.3])
    waves = waves_in(GEL, k, depths)
    kz = k[:, None] * depths
    assert waves.sinking == pytest.approx(np.exp(-kz) * (1 + kz) / (2 * MODULUS_MPA * k[:, None]), rel=2e-3)


@pytest.mark.parametrize('k', [0.05, 0.3, 1.0, 3.0])
def test_shear_across_a_wave_moves_the_layer_as_a_deck_of_cards(k: float) -> None:
    """C = sinh(k (H - z)) / (G k cosh(k H)), from G (C'' - k² C) = 0 between a still base and unit shear on top."""
    depths = np.array([0.0, 2.0, 5.0])
    exact = np.sinh(k * (THICK_MM - depths)) / (MODULUS_MPA * k * np.cosh(k * THICK_MM))
    assert waves_in(GEL, np.array([k]), depths).across[0] == pytest.approx(exact, rel=2e-3, abs=1e-4)


@pytest.mark.parametrize('poisson', [0.5, 0.45, 0.3])
def test_pressure_moves_a_bonded_layer_as_loves_function_says(poisson: float) -> None:
    k, depths = np.geomspace(0.05, 3.0, 9), np.array([0.0, 1.0, 2.5, 4.5])
    waves = waves_in([Elastic(THICK_MM, MODULUS_MPA, poisson)], k, depths)
    radial, vertical = Layer(THICK_MM, MODULUS_MPA, poisson).transforms(k, -depths)
    assert waves.sinking == pytest.approx(-vertical / k[:, None], rel=3e-3, abs=2e-3)
    assert np.abs(waves.pressed) == pytest.approx(np.abs(radial) / k[:, None], rel=3e-3, abs=2e-3)


def test_two_layers_of_one_gel_are_one() -> None:
    k, depths = np.geomspace(0.1, 3.0, 5), np.array([0.5, 3.0])
    one, two = (waves_in(stack, k, depths) for stack in (GEL, [Elastic(1.0, MODULUS_MPA), Elastic(5.0, MODULUS_MPA)]))
    for name in vars(one):
        assert getattr(two, name) == pytest.approx(getattr(one, name), rel=3e-3, abs=2e-3)


def test_what_shear_sinks_is_what_pressure_drags() -> None:
    """Betti: the work of either load on the other's displacement is the same."""
    waves = waves_in(GEL, np.geomspace(0.1, 3.0, 7), np.array([0.0]))
    assert waves.dipping == pytest.approx(waves.pressed, abs=2e-3)
