"""Simulated presses that are held still for several images, as a rig holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.plans import planned_presses, press_count
from tactile_nodes.learning.datasets.simulated import (
    Block,
    Dataset,
    blocks_of_first,
    cropped,
    noise_seeds,
    render,
    simulate,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tasks import Arrays
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.optics import Optics

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
    frames, flow, encoding = config.data.frames_per_rest_image, config.make_flow(), config.make_encoding()
    rest_seeds, seeds = (noise_seeds(config.data.seed, n) for n in (block.rest_number, SEED_BLOCK + block.number))
    rest = average([cropped(config, optics.render((), seed)) for seed in islice(rest_seeds, frames)])
    flow.set_reference(rest)
    encoding.set_reference(rest)
    presses = planned_presses(config.data, block.number, block.first, block.presses)
    seen = [
        encoding.encode(flow.displacement(cropped(config, optics.render((press,), seed))))
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
