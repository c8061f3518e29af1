"""How far each spot of a gel's texture goes, from pictures of presses that a training learns from."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, UInt8

from tactile_nodes.gel_tables import contact_table
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.plans import planned_presses
from tactile_nodes.learning.datasets.simulated import blocks_of, cropped, noise_seeds
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow
from tactile_nodes.sensing.picture.change import PictureComparison
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensing.rest.texture_gains import MOVED_PX, GainsMeasurement, TextureGains
from tactile_nodes.simulation.optics import Optics, Press

MOST_PRESSES, LEAST_PRESSES = 400, 40
"""Four hundred tell nearly all there is; with forty the middle of the gel is known."""

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


class RecordedTexture:
    """From presses as bags tell them, one after another, no more than `most`.

    Presses that belong to a rest image of another place begin anew: the camera was moved.
    """

    def __init__(self, most: int = MOST_PRESSES) -> None:
        self._most, self._count = most, 0
        self._measurement: GainsMeasurement | None = None
        self._comparison: PictureComparison
        self._rest: UInt8[np.ndarray, 'h w'] | None = None

    def take(self, rest: UInt8[np.ndarray, 'h w'], image: UInt8[np.ndarray, 'h w']) -> None:
        """A picture of a press, and the rest image before it, both as cut.

        Raises:
            ImageError: nothing can be measured against the rest image.
        """
        if self._rest is not rest and not self._same_place(rest):
            self._measurement, self._comparison, self._count = GainsMeasurement(rest), PictureComparison(rest), 0
        self._rest = rest
        if self._measurement is not None and self._count < self._most:
            self._measurement.add(image)
            self._count += 1

    def gains(self, rest: UInt8[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
        """What was learned, where a rest image has it; without rows if too few presses told, or of another gel."""
        told = self._measurement.gains() if self._measurement and self._count >= LEAST_PRESSES else None
        learned = told.beside(rest) if told else None
        return np.zeros((0, 0), np.float32) if learned is None else learned

    def _same_place(self, rest: UInt8[np.ndarray, 'h w']) -> bool:
        if self._measurement is None:
            return False
        change = self._comparison.of(rest)
        return change.same and change.size_px < MOVED_PX
