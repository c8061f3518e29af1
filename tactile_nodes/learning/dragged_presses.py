"""The presses that a training learns from, made once more by a tip that drags the skin sideways as it presses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np
from jaxtyping import Float32, Int

from tactile_nodes.gel_tables import contact_table
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.dataset import (
    Block,
    Dataset,
    blocks_of_first,
    cropped,
    noise_seeds,
    render,
)
from tactile_nodes.learning.plans import planned_presses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.reference import average
from tactile_nodes.simulation.optics import Optics, Press

RECIPE = 1
"""Raised when the code below gives other samples for the same configuration."""

SEED_BLOCK = 1 << 21
"""Noise of blocks that no data set has, for pictures of their own."""

SHORTEST = 0.05
"""Of the longest drag: as long is the shortest."""


@dataclass(frozen=True)
class DraggedPresses:
    """The first samples of a training's data set, dragged by `pull_mm` along x and y; those at rest stay at rest."""

    dataset: Dataset
    pull_mm: Float32[np.ndarray, 'samples 2']

    def take(self, rows: Int[np.ndarray, ' chosen']) -> DraggedPresses:
        """Some of the samples."""
        return DraggedPresses(self.dataset.take(rows), self.pull_mm[rows])


def simulate_dragged(config: TrainConfig, progress: Progress) -> DraggedPresses | None:
    """The first `response.dragged_presses` samples of `simulate`, dragged by `response.drag_mm` at most.

    Each by a length and in a direction of chance. Blocks that were made before are read.
    """
    settings = config.response
    if not settings.dragged_presses:
        return None
    blocks = blocks_of_first(config, settings.dragged_presses, f'dragged{RECIPE}-{settings.drag_mm:g}')
    render(blocks, partial(_render_block, settings.drag_mm), progress, 'dragging presses')
    return _load(blocks)


def dragged_presses(block: Block, longest_mm: float) -> list[Press]:
    """The presses of a block of the plan, each with a drag."""
    random = np.random.default_rng([block.config.data.seed, block.number, SEED_BLOCK])
    lengths = random.uniform(SHORTEST * longest_mm, longest_mm, block.presses)
    angles = random.uniform(0, 2 * math.pi, block.presses)
    shifts = np.column_stack([lengths * np.cos(angles), lengths * np.sin(angles)]).tolist()
    presses = planned_presses(block.config.data, block.number, block.first, block.presses)
    return [
        replace(press, shift_mm=tuple(shift) if press.depth_mm > 0 else (0.0, 0.0))
        for press, shift in zip(presses, shifts, strict=True)
    ]


def _render_block(longest_mm: float, block: Block) -> int:
    """As `dataset` makes blocks, beside the same rest image but with noise of their own; returns its number."""
    config = block.config
    optics = Optics(config.gel, table := contact_table(config.gel))
    frames, flow, encoding = config.data.frames_per_rest_image, config.make_flow(), config.make_encoding()
    rest_seeds, seeds = (noise_seeds(config.data.seed, n) for n in (block.rest_number, SEED_BLOCK + block.number))
    rest = average([cropped(config, optics.render((), seed)) for seed in islice(rest_seeds, frames)])
    flow.set_reference(rest)
    encoding.set_reference(rest)
    presses = dragged_presses(block, longest_mm)
    seen = [
        encoding.encode(flow.displacement(cropped(config, optics.render((press,), seed))))
        for press, seed in zip(presses, seeds, strict=False)
    ]
    places = [(each.x_mm, each.y_mm, each.depth_mm, table.force_at(each.depth_mm)) for each in presses]
    draft = block.file.with_suffix('.part.npz')
    np.savez(
        draft,
        presses=np.array(places, np.float32),
        pull_mm=np.array([each.shift_mm for each in presses], np.float32),
        features=np.array([each.values for each in seen], np.float16),
        confidence=np.array([each.confidence for each in seen], np.float32),
    )
    draft.replace(block.file)
    return block.presses


def _load(blocks: Sequence[Block]) -> DraggedPresses:
    loaded = []
    for block in blocks:
        with np.load(block.file) as arrays:
            loaded.append(dict(arrays))
    names = 'features', 'presses', 'confidence', 'pull_mm'
    features, presses, confidence, pull_mm = (np.concatenate([each[name] for each in loaded]) for name in names)
    return DraggedPresses(Dataset(features, presses, np.arange(len(presses)), confidence, 'dragged'), pull_mm)
