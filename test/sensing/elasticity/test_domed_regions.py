"""Domes beside finite elements that know their shape: what regions see of a load on their slope."""

from __future__ import annotations

import numpy as np
import pytest
from domed_layer import DomedLayer

from tactile_nodes.sensing.elasticity.rays import ALONG
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensors import (
    BinSettings,
    CameraDescription,
    GelDescription,
    ImageSettings,
    PatternDescription,
    Sensor,
)
from tactile_nodes.simulation.mechanics import Layer, hertz_transform

DOMED = Sensor(
    'domed', ImageSettings(320, 240, 240, 240),
    CameraDescription('pinhole', 290.0, (240.0, 240.0), (0.0,) * 5, (159.5, 119.5), (0.0, 0.0, -16.0)),
    GelDescription(16.0, 16.0, (4.0,), (0.1,), (0.45,), (0.5, 1.5), 0.0, 'ellipse', 24.0),
    PatternDescription('spheres', 5000, (0.1, 0.15)), BinSettings(8, 8),
)  # fmt: skip
"""4 mm thick in the middle and 2.63 at the rim, where it leans by 19 degrees."""


def ring(radius_mm: np.ndarray) -> np.ndarray:
    """A pressure (MPa) straight down on a ring of 4 mm, 3 mm wide."""
    away = np.abs(np.asarray(radius_mm, float) - 4.0)
    return np.where(away < 1.5, 0.02 * np.cos(np.pi * away / 3.0) ** 2, 0.0)


def predicted(regions: Regions, known: np.ndarray) -> np.ndarray:
    """The motion (px) of regions under the ring, by the response to patches."""
    patches, terms = regions.patches, regions.terms_of_patches(known, slopes=False)
    response = np.einsum('rptu,t->rpu', terms, regions.nominal_shares[::3])
    within = (np.arange(8) + 0.5) / 8 - 0.5
    x, y = np.meshgrid(*(within * side for side in patches.size_mm))
    fine = patches.centres_mm[:, None, None] + np.stack([x, y], -1)
    load = ring(np.hypot(fine[..., 0], fine[..., 1])).mean(axis=(1, 2)) * np.prod(patches.size_mm)
    return np.asarray(response[..., : patches.count] @ load)


def seen(regions: Regions, known: np.ndarray, layer: DomedLayer) -> np.ndarray:
    """The same by finite elements: the mean over the rays of each region of what their displacements move."""
    moved, _ = layer.pressed(ring)
    total = np.zeros((len(known), 2))
    for depth, (depth_mm, share) in enumerate(zip(regions.view.depths_mm, regions.nominal_shares[::3], strict=True)):
        rays = regions.rays.points_mm[depth].reshape(-1, 3)
        radius = np.hypot(rays[:, 0], rays[:, 1])
        outwards, upwards = moved(np.minimum(radius, 20.0), depth_mm)
        by = np.column_stack([rays[:, :2] * (outwards / radius)[:, None], upwards])
        shift = (regions.view.seen_at(rays + 1e-3 * by) - regions.view.seen_at(rays)) / 1e-3
        total += share * shift.reshape(regions.count, ALONG * ALONG, 2).mean(axis=1)[known]
    return total


def test_the_finite_elements_of_a_flat_layer_agree_with_theory() -> None:
    """1 N as Hertz's pressure over 1 mm, beside the layer's Hankel transform."""
    flat = DomedLayer(4.0, np.zeros_like, 0.1, 0.45)
    moved, total = flat.pressed(lambda r: 1.5 / np.pi * np.sqrt(max(1 - r * r, 0.0)))
    radius = np.array([1.0, 2.0, 3.0, 5.0])
    theory = Layer(4.0, 0.1, 0.45).displacement_mm(1.0, radius, np.array([-1.5]))
    for found, expected in zip(moved(radius, np.full(4, 1.5)), theory, strict=True):
        assert found / total == pytest.approx(expected[:, 0], abs=2e-3)
    assert hertz_transform(np.array([0.0])) == pytest.approx([1.0])


def gain(found: np.ndarray, true: np.ndarray) -> float:
    return float((found * true).sum() / (true * true).sum())


def test_a_load_on_the_slope_of_a_dome_moves_regions_as_finite_elements_have_it() -> None:
    """Within a tenth, of which 3 % are in the whole. As a flat gel it would be 11 % too little in the whole, and as the
    simulator has it, everywhere as thick as in the middle, 9 % too much."""
    domed, dome = Regions(DOMED, 10, 10), DOMED.gel.dome
    known = np.flatnonzero(domed.usable)[::4]  # two of each eight that mirror each other
    layer = DomedLayer(4.0, lambda r: dome.height_mm(np.stack([np.minimum(r, 9.0), 0 * r], -1)), 0.1, 0.45)
    true, found = seen(domed, known, layer), predicted(domed, known)
    assert np.linalg.norm(found - true) < 0.1 * np.linalg.norm(true)
    assert gain(found, true) == pytest.approx(1.03, abs=0.02)
