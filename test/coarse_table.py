"""What theory says of gels: tables under the tip, each solved once for all tests of a process; Hertz's pressure."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable, solve


@cache
def coarse_table() -> ContactTable:
    """Solved in few steps: good enough where the force itself is not under test."""
    return solve(Gel(), steps=4)


def linear_table(gel: Gel) -> ContactTable:
    """That of a linear layer, as the simulator has it; hardness, markers and camera do not change how it moves."""
    table = _solved(gel.layer_mm, gel.poisson_ratio, gel.tip_radius_mm)
    return dataclasses.replace(table, force_n=gel.shear_modulus_mpa * table.force_n)


@cache
def _solved(layer_mm: float, poisson_ratio: float, tip_radius_mm: float) -> ContactTable:
    half_mm = layer_mm / 2
    gel = Gel(soft_mm=half_mm, skin_mm=half_mm, poisson_ratio=poisson_ratio, tip_radius_mm=tip_radius_mm)
    return solve(dataclasses.replace(gel, mechanics='linear', shear_modulus_mpa=1.0))


def hertz(layer: ElasticLayer, radius_mm: float) -> np.ndarray:
    """The spectrum of Hertz's pressure over a disc, written out at points: it is as sqrt(1 - r² / a²)."""
    line = np.linspace(-1, 1, 60)[1::2]
    place = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    height = np.sqrt(np.maximum(1 - np.square(place).sum(axis=1), 0.0))
    return layer.points(radius_mm * place[height > 0], height[height > 0])
