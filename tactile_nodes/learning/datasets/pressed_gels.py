"""Simulated presses on gels other than a known one: as in a calibration, and anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from tactile_nodes.collection.plan.plan import load_plan_settings, plan_path
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.learning.config import DataConfig, TrainConfig
from tactile_nodes.learning.datasets.holds import holds_of
from tactile_nodes.learning.datasets.plans import planned_presses, press_count
from tactile_nodes.learning.datasets.simulated import (
    Block,
    Dataset,
    blocks_of_first,
    measured_by,
    noise_seeds,
    render,
    simulate,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays
from tactile_nodes.simulation.optics import Optics
from tactile_nodes.simulation.other_gels import LEARNED_SEED, other_gel

PRESSES_SEED = 5001
FRAMES, WITHOUT_CONTACT, UNTOUCHED = 400, 0.2, 20
PICTURES = 8
"""Images of each press in a calibration: as many as config/calibrate.yaml has the rig take."""
PLAN, PLANNED = 'calibrate', 100


def pressed_gel(config: TrainConfig, number: int) -> tuple[Dataset, Dataset]:
    """One of the gels to learn from, with the camera, flow and features of a configuration.

    Returns presses by the plan of a calibration, and presses anywhere.
    """
    other = replace(config, gel=other_gel(config.gel, number, LEARNED_SEED))
    return planned(other, Progress(), PICTURES), anywhere(other, Progress())


def planned(config: TrainConfig, progress: Progress, pictures: int = 1) -> Dataset:
    """The first presses of the plan of a calibration and some images of the untouched gel, with one rest image.

    Each press is held for `pictures` images.
    """
    plan = load_plan_settings(plan_path(PLAN))
    return _simulated(
        config, progress, pictures, plan=plan.kind, presses=PLANNED, seed=plan.seed, reach_mm=plan.reach_mm,
        shallowest_mm=min(plan.depths_mm), deepest_mm=max(plan.depths_mm),
        without_contact=UNTOUCHED / (PLANNED + UNTOUCHED),
    )  # fmt: skip


def anywhere(config: TrainConfig, progress: Progress, frames: int = FRAMES, seed: int = PRESSES_SEED) -> Dataset:
    """Presses at random places and depths. The same seed gives the same presses on every gel."""
    return _simulated(
        config, progress, presses=frames, seed=seed, reach_mm=13.5, shallowest_mm=0.25, deepest_mm=2.0,
        without_contact=WITHOUT_CONTACT,
    )  # fmt: skip


def _simulated(config: TrainConfig, progress: Progress, pictures: int = 1, **data: Any) -> Dataset:
    settings = DataConfig(presses_per_rest_image=0, processes=1, crop=config.data.crop, **data)
    return simulate_held(replace(config, data=settings), pictures, progress)


def first_presses(dataset: Dataset, presses: int, *, pictures: int | None = None) -> Dataset:
    """The first presses, and some images of the untouched gel, which cost a rig no time.

    Only the first `pictures` of each press are kept; None: all.
    """
    touched = dataset.presses[:, 2] > 0
    holds = holds_of(dataset, np.flatnonzero(touched))[:presses]
    chosen = np.concatenate([*(each[:pictures] for each in holds), np.flatnonzero(~touched)[:UNTOUCHED]])
    return dataset.take(np.sort(chosen))


RECIPE = 1
"""Increased when the code below gives other samples for the same configuration."""

SEED_BLOCK = 1 << 22
"""Added to block numbers to seed the noise of further images. No data set has that many blocks."""


def simulate_held(config: TrainConfig, pictures: int, progress: Progress) -> Dataset:
    """`simulate`, with `pictures` images of each press in total. Samples without contact keep one image.

    Further images differ from the first only in noise, and come after all first ones. Blocks made before are read from
    their files.
    """
    first = simulate(config, progress)
    if pictures == 1:
        return first
    blocks = blocks_of_first(config, press_count(config.data), f'held{RECIPE}-{pictures}')
    render(blocks, partial(_render_block, pictures - 1), progress, 'holding presses')
    return _joined(first, blocks, pictures - 1)


def _render_block(further: int, block: Block) -> Arrays:
    """`further` more images of each press, against the same rest image."""
    config = block.config
    optics = Optics(config.gel, contact_table(config.gel))
    measured, seeds = measured_by(block, optics), noise_seeds(config.data.seed, SEED_BLOCK + block.number)
    presses = planned_presses(config.data, block.number, block.first, block.presses)
    seen = [
        measured(optics.render((press,), seed))
        for press in presses if press.depth_mm > 0 for seed in islice(seeds, further)
    ]  # fmt: skip
    return {
        'features': np.array([each.values for each in seen], np.float16),
        'confidence': np.array([each.confidence for each in seen], np.float32),
    }


def _joined(first: Dataset, blocks: Sequence[Block], further: int) -> Dataset:
    parts = []
    for block in blocks:
        with np.load(block.file) as arrays:
            parts.append(dict(arrays))
    parts = [each for each in parts if len(each['features'])]
    features, confidence = (np.concatenate([each[name] for each in parts]) for name in ('features', 'confidence'))
    again = np.repeat(np.flatnonzero(first.presses[:, 2] > 0), further)
    return replace(
        first,
        features=np.concatenate([first.features, features]),
        presses=np.concatenate([first.presses, first.presses[again]]),
        rest=np.concatenate([first.rest, len(first.confidence) + np.arange(len(again))]),
        confidence=np.concatenate([first.confidence, confidence]),
        hold=np.concatenate([np.arange(len(first.presses)), again]),
    )
