"""Simulated touches of random bodies, with the true forces on patches, on gels that differ as units of a sensor do."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_nodes import paths
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.contact_tables.touch_tables import first_solved, random_ways
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.simulated import Block, measured_by, noise_seeds, recipe_id
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays, make_files
from tactile_nodes.sensing.elasticity.patches import PER_BIN
from tactile_nodes.sensing.explain.field.where_now import HIDDEN
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics
from tactile_nodes.simulation.other_gels import LEARNED_SEED, other_gel
from tactile_nodes.simulation.touch.random_bodies import random_body
from tactile_nodes.simulation.touch.table import Touch, TouchTable, node_forces, over_bins

GELS = 6
"""Gels that are touched in turn."""

PLACES = 12
"""Pictures of each body: at other places, turned, and at any stage of its path."""

SEED, NOISE_BLOCK = 7001, 1 << 23
LIGHTEST_N, HARDEST_N = 0.05, 3.0
RIM_MM = 1.0
NAME = 'random'
RECIPE = 2
"""Increased when the code below gives other touches for the same configuration."""


@dataclass(frozen=True)
class Touches:
    """Features and confidence of pictures, and the true forces on patches: into the gel, along x, along y [N].

    The forces are where a solved field should have them, before `moved_along`. `gel` is the number of the gel.
    """

    gel: int
    features: Float32[np.ndarray, 'n rows cols channels']
    confidence: Float32[np.ndarray, 'n rows cols']
    forces_n: Float32[np.ndarray, 'n 3 h w']


@dataclass(frozen=True)
class _Touched:
    """Task: one body on one gel."""

    config: TrainConfig
    number: int


def touched_gel(config: TrainConfig, number: int) -> TrainConfig:
    """The configuration with the gel that the body of this number touches."""
    return replace(config, gel=other_gel(config.gel, number % GELS, LEARNED_SEED))


def random_touches(config: TrainConfig, bodies: int, progress: Progress) -> list[Touches]:
    """The touches of each body that can be pressed; those made before are read from their files.

    `config` gives the gel that others differ from, the camera, flow and features.
    """
    jobs = []
    for number in range(bodies):
        job = _Touched(touched_gel(config, number), number)
        jobs.append((_file_of(job), job))
    make_files(_render, jobs, config.data.processes, progress, 'touching with random bodies')
    found = []
    for file, job in jobs:
        with np.load(file) as arrays:
            maps = (arrays[name].astype(np.float32) for name in ('features', 'confidence', 'forces'))
            found.append(Touches(job.number % GELS, *maps))
    return [each for each in found if len(each.features)]


def _file_of(job: _Touched) -> Path:
    recipe = json.dumps([RECIPE, HIDDEN, recipe_id(job.config), job.number])
    return paths.cache_directory('touched') / f'{hashlib.sha256(recipe.encode()).hexdigest()[:16]}.npz'


def _render(job: _Touched) -> Arrays:
    """The touches of a body; none if it cannot be pressed into the gel."""
    config, random = job.config, np.random.default_rng([SEED, job.number])
    gel, bins = config.gel, config.bins
    patches = BinGrid(PER_BIN * bins.rows, PER_BIN * bins.cols, bins.width_mm, bins.height_mm)
    features, confidence, forces = [], [], []
    with suppress(ConfigurationError):
        table = _solved(gel, random)
        optics = Optics(gel, contact_table(gel), bodies={NAME: table})
        measured = measured_by(Block(config, job.number, 0, 0, Path()), optics)
        seeds = noise_seeds(config.data.seed, NOISE_BLOCK + job.number)
        for touch, seed in zip(_placed(gel, table, random), seeds, strict=False):
            seen = measured(optics.render((touch,), seed))
            place_mm, force = node_forces(table, touch, 1 - HIDDEN)
            on_patches = over_bins(place_mm, force * gel.shear_modulus_mpa, table.node_size_mm, patches)
            features.append(seen.values)
            confidence.append(seen.confidence)
            forces.append(on_patches.transpose(2, 0, 1)[[2, 0, 1]])
    return {'features': np.array(features), 'confidence': np.array(confidence), 'forces': np.array(forces)}


def _solved(gel: Gel, random: np.random.Generator) -> TouchTable:
    """A random body, pressed and mostly dragged."""
    body = random_body(random)
    force_n = LIGHTEST_N + (HARDEST_N - LIGHTEST_N) * float(random.uniform()) ** 1.2
    return first_solved(gel, body, random_ways(random, gel, force_n, LIGHTEST_N))


def _placed(gel: Gel, table: TouchTable, random: np.random.Generator) -> Iterator[Touch]:
    """The body anywhere on the gel, half of the time at the last stage of its path."""
    extent_mm, last = float(np.hypot(*table.node_mm.T).max(initial=0.0)), table.stages - 1
    reach_mm = np.maximum(np.array(gel.sides_mm) / 2 - RIM_MM - extent_mm, 0.0)
    for _ in range(PLACES):
        x_mm, y_mm = (random.uniform(-1, 1, 2) * reach_mm).tolist()
        stage = last if random.uniform() < 0.5 else random.uniform(0.6, last)
        yield Touch(NAME, x_mm, y_mm, float(random.uniform(0, math.tau)), float(stage))
