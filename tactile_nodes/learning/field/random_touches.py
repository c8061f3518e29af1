"""Simulated touches of random bodies, with the true forces on patches, on gels that differ as units of a sensor do."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from tactile_nodes import paths
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.contact_tables.touch_tables import first_solved, random_ways
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.simulated import measuring, noise_seeds
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays, make_files
from tactile_nodes.sensing.elasticity.patches import PER_BIN
from tactile_nodes.sensing.explain.field.where_now import HIDDEN
from tactile_nodes.sensing.features import Features, make_encoding
from tactile_nodes.sensing.flow.choice import code_id, make_flow
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics
from tactile_nodes.simulation.touch.random_bodies import random_body
from tactile_nodes.simulation.touch.table import Touch, TouchTable, node_forces, over_bins

PLACES = 12
"""Pictures of each body: at other places, turned, and at any stage of its path."""

SEED, NOISE_BLOCK = 7001, 1 << 23
REST_FRAMES = 16
LIGHTEST_N, HARDEST_N = 0.05, 3.0
RIM_MM = 1.0
NAME = 'random'
RECIPE = 3
"""Increased when the code below gives other touches for the same scene."""


@dataclass(frozen=True)
class Scene:
    """A gel that is touched, and how its pictures are measured; `size_px` is what is cut from their middle.

    If `to_rim`, bodies touch up to the rim, and every second one has one part: larger ones reach it less often.
    """

    gel: Gel
    bins: BinGrid
    size_px: tuple[int, int]
    flow: Choice
    encoding: Choice
    seed: int = 1
    to_rim: bool = False

    def measuring(self, optics: Optics) -> Callable[[np.ndarray], Features]:
        """Measures camera images against an average of images at rest."""
        flow = make_flow(self.flow.name, self.flow.options)
        encoding = make_encoding(self.encoding.name, self.encoding.options)
        return measuring(flow, encoding, self.size_px, optics, islice(noise_seeds(self.seed, 0), REST_FRAMES))


@dataclass(frozen=True)
class Touches:
    """Features and confidence of pictures, and the true forces on patches: into the gel, along x, along y [N].

    The forces are where a solved field should have them, before `moved_along`. `scene` is the number of the scene.
    """

    scene: int
    features: Float32[np.ndarray, 'n rows cols channels']
    confidence: Float32[np.ndarray, 'n rows cols']
    forces_n: Float32[np.ndarray, 'n 3 h w']


@dataclass(frozen=True)
class _Touched:
    """Task: one body in one scene."""

    scene: Scene
    number: int


def random_touches(scenes: Sequence[Scene], bodies: int, processes: int, progress: Progress) -> list[Touches]:
    """Touches of bodies in these scenes by turns; those made before are read from their files.

    Bodies that cannot be pressed are left out.
    """
    jobs = []
    for number in range(bodies):
        job = _Touched(scenes[number % len(scenes)], number)
        jobs.append((_file_of(job), job))
    make_files(_render, jobs, processes, progress, 'touching with random bodies')
    found = []
    for file, job in jobs:
        with np.load(file) as arrays:
            maps = (arrays[name].astype(np.float32) for name in ('features', 'confidence', 'forces'))
            found.append(Touches(job.number % len(scenes), *maps))
    return [each for each in found if len(each.features)]


def _file_of(job: _Touched) -> Path:
    scene = {**asdict(job.scene), 'gel': job.scene.gel.gel_id}
    recipe = json.dumps([RECIPE, HIDDEN, code_id(), cv2.__version__, scene, job.number], sort_keys=True)
    return paths.cache_directory('touched') / f'{hashlib.sha256(recipe.encode()).hexdigest()[:16]}.npz'


def _render(job: _Touched) -> Arrays:
    """The touches of a body; none if it cannot be pressed into the gel."""
    scene, random = job.scene, np.random.default_rng([SEED, job.number])
    gel, bins = scene.gel, scene.bins
    patches = BinGrid(PER_BIN * bins.rows, PER_BIN * bins.cols, bins.width_mm, bins.height_mm)
    features, confidence, forces = [], [], []
    with suppress(ConfigurationError):
        table = _solved(gel, random, single=scene.to_rim and job.number % 2 == 1)
        optics = Optics(gel, contact_table(gel), bodies={NAME: table})
        measured = scene.measuring(optics)
        seeds = noise_seeds(scene.seed, NOISE_BLOCK + job.number)
        for touch, seed in zip(_placed(gel, table, random, 0.0 if scene.to_rim else RIM_MM), seeds, strict=False):
            seen = measured(optics.render((touch,), seed))
            place_mm, force = node_forces(table, touch, 1 - HIDDEN)
            on_patches = over_bins(place_mm, force * gel.shear_modulus_mpa, table.node_size_mm, patches)
            features.append(seen.values)
            confidence.append(seen.confidence)
            forces.append(on_patches.transpose(2, 0, 1)[[2, 0, 1]])
    return {'features': np.array(features), 'confidence': np.array(confidence), 'forces': np.array(forces)}


def _solved(gel: Gel, random: np.random.Generator, *, single: bool) -> TouchTable:
    """A random body, pressed and mostly dragged."""
    body = random_body(random, single=single)
    force_n = LIGHTEST_N + (HARDEST_N - LIGHTEST_N) * float(random.uniform()) ** 1.2
    return first_solved(gel, body, random_ways(random, gel, force_n, LIGHTEST_N))


def _placed(gel: Gel, table: TouchTable, random: np.random.Generator, rim_mm: float) -> Iterator[Touch]:
    """The body anywhere on the gel, half of the time at the last stage of its path."""
    extent_mm, last = float(np.hypot(*table.node_mm.T).max(initial=0.0)), table.stages - 1
    reach_mm = np.maximum(np.array(gel.sides_mm) / 2 - rim_mm - extent_mm, 0.0)
    for _ in range(PLACES):
        x_mm, y_mm = (random.uniform(-1, 1, 2) * reach_mm).tolist()
        stage = last if random.uniform() < 0.5 else random.uniform(0.6, last)
        yield Touch(NAME, x_mm, y_mm, float(random.uniform(0, math.tau)), float(stage))
