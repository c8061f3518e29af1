"""The layer in bricks against the linear layer by Hankel transform, and against what any elastic body must do."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tactile_nodes.simulation.mechanics import Layer as LinearLayer
from tactile_nodes.simulation.touch.bricks import Bricks, Layer


@pytest.fixture(scope='module')
def bricks() -> Bricks:
    return Bricks(Layer(cells=48, spacing_mm=0.8, rows=8))


def load(bricks: Bricks, traction: np.ndarray, axis: int) -> np.ndarray:
    """Displacements under tractions on the surface, in the linear layer."""
    layer = bricks.layer
    force = np.zeros((layer.rows, 3, layer.cells, layer.cells), np.float32)
    force[-1, axis] = traction * layer.spacing_mm**2
    return bricks.answer(force, np.zeros_like(force[:, 0]))[0]


def test_a_layer_at_rest_has_no_forces(bricks: Bricks):
    force, lacking, least = bricks.forces(bricks.at_rest())
    assert np.abs(force).max() == 0
    assert np.abs(lacking).max() == 0
    assert least == 1


def test_the_linear_answer_undoes_small_displacements(bricks: Bricks):
    random = np.random.default_rng(1)
    state = bricks.at_rest()
    state.moved[1:] = 1e-4 * random.standard_normal(state.moved[1:].shape)
    state.pressure[:] = 1e-4 * random.standard_normal(state.pressure.shape)
    force, lacking, _ = bricks.forces(state)
    moved, pressure = bricks.answer(force, lacking)
    assert np.abs(moved - state.moved[1:]).max() < 2e-3 * 1e-4 * 5
    assert np.abs(pressure - state.pressure).max() < 0.05 * 1e-4 * 5  # volumes change by the square of strains


@pytest.mark.parametrize('waves', [2, 4, 6])
def test_waves_of_pressure_and_of_shear_move_the_surface_as_theory_says(bricks: Bricks, waves: int):
    """Of a bonded incompressible layer, cos kx pressed in sinks by B cos kx, sheared across k goes tanh(kH)/(Gk)."""
    layer = bricks.layer
    k = 2 * np.pi * waves / layer.width_mm
    near = 0.01 + (k * layer.spacing_mm) ** 2 / 8  # a wave of few bricks is softer than it should be
    wave = np.broadcast_to(np.cos(k * layer.line_mm), (layer.cells, layer.cells))
    _, sinks = LinearLayer(layer.thickness_mm, 1.0).transforms(np.array([k]), np.array([0.0]))
    middle = layer.cells // 2
    pressed = load(bricks, -wave, 2)[-1, 2, middle, middle]
    assert pressed == pytest.approx(sinks[0, 0] / k, rel=near)
    sheared = load(bricks, wave, 1)[-1, 1, middle, middle]
    assert sheared == pytest.approx(np.tanh(k * layer.thickness_mm) / k, rel=near)


def test_forces_are_the_slope_of_an_energy():
    """The work on the way to a large deformation does not depend on the way: there is no force but an elastic one."""
    random, bricks = np.random.default_rng(2), Bricks(Layer(cells=16, spacing_mm=0.8, rows=5))
    shape = bricks.at_rest().moved[1:].shape
    ends = [np.float32(0.05) * random.standard_normal(shape).astype(np.float32) for _ in range(2)]

    def work(path: list[np.ndarray]) -> float:
        total, state = 0.0, bricks.at_rest()
        for start, end in itertools.pairwise(path):
            for share in (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5):
                state.moved[1:] = start + share * (end - start)
                total += 0.5 * float((bricks.forces(state)[0] * (end - start)).sum(dtype=np.float64))
        return total

    zero = np.zeros_like(ends[0])
    steps = [zero + share * (ends[0] + ends[1]) for share in np.linspace(0, 1, 9).astype(np.float32)]
    around = [share * ends[0] for share in np.linspace(0, 1, 9).astype(np.float32)]
    around += [ends[0] + share * ends[1] for share in np.linspace(0, 1, 9)[1:].astype(np.float32)]
    assert work(around) == pytest.approx(work(steps), rel=2e-3)


def test_a_layer_turned_as_a_whole_has_no_stress(bricks: Bricks):
    """Every brick but those at the seam of the periodic layer: neo-Hooke does not feel a turn."""
    layer, turn = bricks.layer, 0.3
    state = bricks.at_rest()
    x, z = np.meshgrid(layer.line_mm, layer.z_mm)
    state.moved[:, 0] = ((np.cos(turn) - 1) * x + np.sin(turn) * z)[:, None, :]
    state.moved[:, 2] = (-np.sin(turn) * x + (np.cos(turn) - 1) * z)[:, None, :]
    force, lacking, _ = bricks.forces(state)
    assert np.abs(force[:-1, :, :, 4:-4]).max() < 1e-4
    assert np.abs(lacking[..., 4:-4]).max() < 1e-4
