"""Presses on a gel whose motion is known: a Gaussian field around the tip, in 6x6 regions, with noise."""

from __future__ import annotations

import numpy as np

from tactile_nodes.learning.config import AxisymmetricConfig, ResponseConfig
from tactile_nodes.learning.datasets.simulated import Dataset

CONFIG = ResponseConfig(components=16, spacing_mm=2.0, levels=3, smoothing=(1e-3, 1e-1, 10.0, 1e5), most_contacts=1)
AXISYMMETRIC = AxisymmetricConfig(
    lateral=1, vertical=1, turns=4, presses_per_turn=150, most_presses=300, most_contacts=1
)
NOISE_PX = 0.01
REACH_MM = 10.0


def motion(places: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Displacement (px) of each region."""
    along = np.linspace(-11.0, 11.0, 6)
    away = np.stack(np.meshgrid(along, along), axis=-1)[None] - places[:, None, None]
    bell = np.exp(-(away**2).sum(axis=-1, keepdims=True) / (2 * 5.0**2))
    field: np.ndarray = force[:, None, None, None] * away * bell / 3.0
    return field


def presses(count: int, seed: int, still: float = 0.15) -> Dataset:
    """Random places and forces; a share `still` of the frames is without contact."""
    random = np.random.default_rng(seed)
    places, force = random.uniform(-REACH_MM, REACH_MM, (count, 2)), random.uniform(0.05, 1.0, count)
    force[random.random(count) < still] = 0.0
    return seen_with_noise(motion(places, force), places, force, random)


def seen_with_noise(field: np.ndarray, places: np.ndarray, force: np.ndarray, random: np.random.Generator) -> Dataset:
    """Presses under which regions move like that; a force of 0 is a frame without contact."""
    features = (field + NOISE_PX * random.normal(size=field.shape)).astype(np.float16)
    rows = np.column_stack([places, np.where(force > 0, 2 * force, -1.0), force]).astype(np.float32)
    return Dataset(features, rows, np.zeros(len(rows), int), np.ones((1, 6, 6), np.float32), 'made')
