"""A stack of elastic layers, bonded to each other and to a rigid base, under waves of load on its surface.

Everything is linear and isotropic, so a load splits into waves cos kx, and each wave causes waves of displacement.
With z out of the gel and depth counted down from the surface,

    a pressure cos kx         moves by  x: A sin kx   down: B cos kx
    a shear sin kx along x    moves by  x: L sin kx   down: D cos kx
    a shear cos kx along y    moves by  y: C cos kx

These five functions of k and depth come from finite elements over the depth: quadratic displacement, linear pressure,
graded towards the surface. Half-space: B = (1 - nu) / (G k) at the surface; a bonded layer: C = tanh(k H) / (G k).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float

FIRST_MM, GROWTH, THICKEST_MM = 0.05, 1.12, 0.5
"""Thickness of the element at the surface, growth from one element to the next, and largest thickness."""

POINTS, POINT_WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True)
class Elastic:
    """One layer: thickness [mm], shear modulus [MPa], Poisson's ratio up to 0.5."""

    thickness_mm: float
    shear_modulus_mpa: float
    poisson_ratio: float = 0.5


@dataclass(frozen=True)
class Waves:
    """The five functions [mm/MPa] at wave numbers [1/mm] and depths, or at depths and a grid of waves."""

    pressed: Float[np.ndarray, '*known']
    sinking: Float[np.ndarray, '*known']
    sheared: Float[np.ndarray, '*known']
    dipping: Float[np.ndarray, '*known']
    across: Float[np.ndarray, '*known']


def waves_in(
    layers: Sequence[Elastic], wave_numbers: Float[np.ndarray, ' waves'], depths_mm: Float[np.ndarray, ' depths']
) -> Waves:
    """The five functions at depths; `layers` from the surface down.

    An incompressible layer of 6 mm and 0.111 MPa at k = 1 / mm: `across` at the surface is tanh(6) / 0.111 = 9.009.
    """
    lines, material = _elements(layers)
    plane, cross = _matrices(lines, material, wave_numbers)
    nodes = 2 * len(material) + 1
    free = 2 * (nodes - 1)
    loads = np.zeros((len(wave_numbers), plane.shape[1], 2))
    loads[:, 1, 0] = loads[:, 0, 1] = 1.0
    moved = np.linalg.solve(plane, loads)[:, :free].reshape(len(wave_numbers), nodes - 1, 2, 2)
    right = np.zeros((len(wave_numbers), nodes - 1, 1))
    right[:, 0] = 1.0
    aside = np.linalg.solve(cross, right)[..., 0]
    at = _interpolation(lines, depths_mm)[:, :-1]
    planar = np.einsum('zn,knal->kzal', at, moved)
    return Waves(planar[..., 0, 0], planar[..., 1, 0], planar[..., 0, 1], planar[..., 1, 1], aside @ at.T)


def _elements(layers: Sequence[Elastic]) -> tuple[np.ndarray, list[Elastic]]:
    """Depths of the elements' borders, and the material of each element."""
    lines, material, thickness = [0.0], list[Elastic](), FIRST_MM
    for layer in layers:
        steps: list[float] = []
        while sum(steps) < layer.thickness_mm:
            steps.append(thickness)
            thickness = min(thickness * GROWTH, THICKEST_MM)
        scaled = np.cumsum(steps) * layer.thickness_mm / sum(steps)
        lines += (lines[-1] + scaled).tolist()
        material += [layer] * len(steps)
    return np.array(lines), material


def _matrices(lines: np.ndarray, material: list[Elastic], k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices in the plane of the wave (displacements, then pressures) and across it; the base is fixed."""
    count = len(material)
    nodes, k = 2 * count + 1, k[:, None, None]
    stiff = np.zeros((len(k), 2 * nodes, 2 * nodes))
    coupling = np.zeros((len(k), 2 * nodes, 2 * count))
    softness, cross = np.zeros((2 * count, 2 * count)), np.zeros((len(k), nodes, nodes))
    for number, (layer, thick) in enumerate(zip(material, np.diff(lines), strict=True)):
        modulus, node = layer.shear_modulus_mpa, 2 * number + np.arange(3)
        along, down, own = 2 * node, 2 * node + 1, 2 * number + np.arange(2)
        values, slopes, pressures, weights = _shapes(float(thick))
        both = np.einsum('q,qa,qb->ab', weights, values, values)
        steep = np.einsum('q,qa,qb->ab', weights, slopes, slopes)
        mixed = np.einsum('q,qa,qb->ab', weights, slopes, values)
        stiff[:, along[:, None], along] += modulus * (2 * k**2 * both + steep)
        stiff[:, down[:, None], down] += modulus * (2 * steep + k**2 * both)
        stiff[:, along[:, None], down] -= modulus * k * mixed
        stiff[:, down[:, None], along] -= modulus * k * mixed.T
        coupling[:, along[:, None], own] += k * np.einsum('q,qa,qp->ap', weights, values, pressures)
        coupling[:, down[:, None], own] += np.einsum('q,qa,qp->ap', weights, slopes, pressures)
        spare = 1 - 2 * layer.poisson_ratio
        if spare > 0:
            lame = 2 * modulus * layer.poisson_ratio / spare
            softness[own[:, None], own] += np.einsum('q,qp,qr->pr', weights, pressures, pressures) / max(lame, 1e-9)
        cross[:, node[:, None], node] += modulus * (steep + k**2 * both)
    free = 2 * nodes - 2
    top = np.concatenate([stiff[:, :free, :free], coupling[:, :free]], axis=2)
    below = np.concatenate(
        [coupling[:, :free].transpose(0, 2, 1), np.broadcast_to(-softness, (len(k), 2 * count, 2 * count))], axis=2
    )
    return np.concatenate([top, below], axis=1), cross[:, :-1, :-1]


def _shapes(thick: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Quadratic shape functions, their derivatives, linear ones, and weights at three points of an element."""
    values = np.stack([POINTS * (POINTS - 1) / 2, 1 - POINTS**2, POINTS * (POINTS + 1) / 2], -1)
    slopes = np.stack([POINTS - 0.5, -2 * POINTS, POINTS + 0.5], -1) * 2 / thick
    return values, slopes, np.stack([np.ones(3), POINTS], -1), POINT_WEIGHTS * thick / 2


def _interpolation(lines: np.ndarray, depths: np.ndarray) -> Float[np.ndarray, 'depths nodes']:
    """Weight of each node at each depth."""
    cell = np.clip(np.searchsorted(lines, depths, side='right') - 1, 0, len(lines) - 2)
    x = 2 * (depths - lines[cell]) / (lines[cell + 1] - lines[cell]) - 1
    at = np.zeros((len(depths), 2 * len(lines) - 1))
    rows = np.arange(len(depths))[:, None]
    at[rows, 2 * cell[:, None] + np.arange(3)] = np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], -1)
    return at
