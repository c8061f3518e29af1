"""Presses of a small ball on an elastic layer as a sensor's description has it, in 8x8 regions, with noise."""

from __future__ import annotations

import dataclasses

import numpy as np
from coarse_table import hertz

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import Bodies, KnownBody
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensors import BinSettings, Sensor

SIDE, NOISE_PX, MOST = 8, 0.004, 60
BALL = Bodies.one(KnownBody.named('ball:0.6'), MOST)
SENSOR = dataclasses.replace(Sensor(), bins=BinSettings(6, 6))
"""The simulated sensor, with bins of 5.3 mm."""
Terms = tuple[np.ndarray, np.ndarray]


def regions() -> Regions:
    return Regions(SENSOR, SIDE, SIDE)


def quiet_scaling() -> InputScaling:
    """All regions are known and rest at nothing."""
    shape = SIDE, SIDE, 2
    return InputScaling(
        np.zeros(shape, np.float32), np.full(shape, 1 / NOISE_PX, np.float32), np.ones(shape[:2], np.float32)
    )


def pressed_terms() -> Terms:
    """Places on the surface, and what each term of all regions makes of 1 N there."""
    places, gel = np.random.default_rng(4).uniform(-12, 12, (MOST, 2)), regions()
    return places, gel.terms_of_pressure(places, hertz(gel.layer, 0.5), np.arange(gel.count))


def pressed(terms: Terms, shares: np.ndarray, count: int) -> Dataset:
    """Presses of 0.1 to 0.3 N on a gel whose regions have these shares."""
    random, (places, made) = np.random.default_rng(5), (each[:count] for each in terms)
    force = random.uniform(0.1, 0.3, count)
    motion = np.einsum('nrpt,rt->nrp', made, shares) * force[:, None, None]
    motion = (motion + NOISE_PX * random.standard_normal(motion.shape)).reshape(count, SIDE, SIDE, 2)
    rows = np.column_stack([places, np.full(count, 0.5), force]).astype(np.float32)
    return Dataset(motion.astype(np.float16), rows, np.zeros(count, int), np.ones((1, SIDE, SIDE), np.float32), 'made')


def pressed_gel(real: Regions, count: int) -> Dataset:
    """So many presses on a gel that is described otherwise than it is."""
    places = np.random.default_rng(4).uniform(-12, 12, (count, 2))
    made = real.terms_of_pressure(places, hertz(real.layer, 0.5), np.arange(real.count))
    return pressed((places, made), nominal(), count)


def response_of(real: Regions) -> np.ndarray:
    true: np.ndarray = np.einsum('rptu,rt->rpu', real.terms_of_patches(np.arange(real.count)), nominal())
    return true.reshape(2 * real.count, -1)


def nominal() -> np.ndarray:
    """The shares that the description tells."""
    gel = regions()
    return np.tile(gel.nominal_shares, (gel.count, 1))


def uneven() -> np.ndarray:
    """The same where each region's depths count up to half more or less."""
    shares = nominal()
    shares[:, ::3] *= np.random.default_rng(6).uniform(0.5, 1.5, shares[:, ::3].shape)
    return shares
