"""How far each spot of a gel's texture goes, from pictures of presses that a training learns from."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Int

from tactile_nodes.gel_tables import contact_table
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.dataset import blocks_of, cropped, noise_seeds
from tactile_nodes.learning.plans import planned_presses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.fixed_reference import InverseCompositionalFlow
from tactile_nodes.sensing.reference import average
from tactile_nodes.sensing.texture_gains import GainsMeasurement, TextureGains
from tactile_nodes.simulation.optics import Optics, Press

REST_SEED_BLOCK = 1 << 20
"""Noise of a block that no data set has, for pictures of their own."""


def simulated_texture(
    config: TrainConfig, chosen: Int[np.ndarray, ' chosen'], progress: Progress
) -> TextureGains | None:
    """From the first `response.texture_presses` of the chosen samples of `simulate` that touch.

    None where the model would not use it: only responses read by patches do.
    """
    wanted = config.response.texture_presses
    by_patches = config.flow.name == InverseCompositionalFlow.name
    if config.readout != 'response' or not by_patches or not wanted:
        return None
    optics, seeds = Optics(config.gel, contact_table(config.gel)), noise_seeds(config.data.seed, REST_SEED_BLOCK)
    frames = islice(seeds, config.data.frames_per_rest_image)
    measurement = GainsMeasurement(average([cropped(config, optics.render((), seed)) for seed in frames]))
    presses = _first_touching(config, {int(each) for each in chosen}, wanted)
    with progress.bar('learning the texture', len(presses)) as bar:
        for press, seed in zip(presses, seeds, strict=False):
            measurement.add(cropped(config, optics.render((press,), seed)))
            bar.advance(1)
    return measurement.gains()


def _first_touching(config: TrainConfig, chosen: set[int], wanted: int) -> list[Press]:
    found: list[Press] = []
    for block in blocks_of(config, Path()):
        presses = planned_presses(config.data, block.number, block.first, block.presses)
        found += [press for number, press in enumerate(presses, block.first) if number in chosen and press.depth_mm > 0]
        if len(found) >= wanted:
            break
    return found[:wanted]
