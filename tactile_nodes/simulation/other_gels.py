"""Variations of a gel, as units of one sensor differ."""

from __future__ import annotations

import dataclasses

import numpy as np

from tactile_nodes.simulation.gel import Gel

TESTED_SEED, LEARNED_SEED = 77, 1077
"""Seeds of the gels that calibrations are tested on, and of those that something is learned from; they differ."""


def other_gel(gel: Gel, number: int, seed: int = TESTED_SEED) -> Gel:
    """A gel that differs from another as units of one sensor do; thickness in three steps."""
    random = np.random.default_rng([seed, number])
    stiffer = _within(random, 0.3)
    thicker = 0.3 * float(random.integers(-1, 2))
    shift = _within(random, 1.0), _within(random, 1.0)
    tilt = _within(random, 2.0), _within(random, 2.0)
    return dataclasses.replace(
        gel,
        seed=100 + number + (seed - TESTED_SEED),
        shear_modulus_mpa=gel.shear_modulus_mpa * (1 + stiffer),
        soft_mm=gel.soft_mm + thicker,
        camera_shift_mm=shift,
        camera_tilt_deg=tilt,
        focal_px_per_rad=gel.focal_px_per_rad * (1 + _within(random, 0.03)),
        camera_roll_deg=_within(random, 3.0),
    )


def _within(random: np.random.Generator, most: float) -> float:
    return float(random.uniform(-most, most))
