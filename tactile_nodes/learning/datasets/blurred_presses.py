"""Presses as blurred pictures show them: of the same pictures that a training learns from, blurred by so much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.gel_tables import contact_table
from tactile_nodes.learning.config import TrainConfig
from tactile_nodes.learning.datasets.blurred_pictures import PictureNoise, SoftwareBlur
from tactile_nodes.learning.datasets.plans import planned_presses
from tactile_nodes.learning.datasets.simulated import (
    Block,
    Dataset,
    blocks_of_first,
    cropped,
    noise_seeds,
    render,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.features import FeatureEncoding, Features
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.picture.quality import sharpness
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.sensing.rest.texture_places import other_texture
from tactile_nodes.simulation.optics import Optics

RECIPE = 1
"""Raised when the code below gives other samples for the same configuration."""


@dataclass(frozen=True)
class BlurredPresses:
    """The first samples of a training's data set, measured in blurred pictures.

    `sharpness` is that of the blurred rest images, `sharp` that of the rest images themselves (means over them).
    """

    sharp: float
    sharpness: float
    dataset: Dataset


class BlurredMeasurer:
    """Features of blurred pictures, as the live chain measures them beside a renewed rest image.

    Motion is taken for what the first rest image's texture would have shown; see `texture_places`.
    """

    def __init__(self, sigma_px: float, flow: FlowMethod, encoding: FeatureEncoding) -> None:
        self._sigma_px, self._flow, self._encoding = sigma_px, flow, encoding

    def use_reference(self, frames: Sequence[np.ndarray], first: FlowMethod, noise: PictureNoise, seed: int) -> None:
        """Measure against the blurred mean of some frames; `first` is the flow against that of the sharp ones."""
        self._blur = SoftwareBlur(self._sigma_px, noise, seed)
        rest = average([self._blur(each) for each in frames])
        self._flow.set_reference(rest)
        self._encoding.set_reference(rest)
        self._other, self.sharpness = other_texture(self._flow, first, rest.shape), sharpness(rest)

    def measure(self, image: UInt8[np.ndarray, 'h w']) -> Features:
        """Of one picture."""
        field = self._flow.displacement(self._blur(image))
        return self._encoding.encode(self._other.as_first(field) if self._other else field)


def simulate_blurred(config: TrainConfig, progress: Progress) -> tuple[BlurredPresses, ...]:
    """The first `response.blurred_presses` samples of `simulate`, for each of `response.blur_px`.

    Blocks that were made before are read.

    Raises:
        ConfigurationError: blurs are not given in order, each stronger than the one before.
    """
    settings = config.response
    if not settings.blur_px or not settings.blurred_presses:
        return ()
    require_in_order(settings.blur_px)
    name = f'blurred{RECIPE}-{"-".join(f"{each:g}" for each in settings.blur_px)}'
    blocks = blocks_of_first(config, settings.blurred_presses, name)
    render(blocks, partial(_render_block, settings.blur_px), progress, 'blurring presses')
    return _load(blocks, len(settings.blur_px))


def require_in_order(blur_px: Sequence[float]) -> None:
    """Refuse blurs that are none, or not in order. Raises ConfigurationError."""
    if any(weaker >= stronger for weaker, stronger in zip((0.0, *blur_px), blur_px, strict=False)):
        raise ConfigurationError('response.blur_px must name blurs in px, each stronger than the one before, above 0')


def _render_block(blur_px: Sequence[float], block: Block) -> int:
    """As `dataset` makes blocks, blurred by so much each; returns its number of presses."""
    config = block.config
    optics = Optics(config.gel, table := contact_table(config.gel))
    frames = config.data.frames_per_rest_image
    rest_seeds, seeds = (noise_seeds(config.data.seed, number) for number in (block.rest_number, block.number))
    rest = [cropped(config, optics.render((), seed)) for seed in islice(rest_seeds, frames)]
    first, noise = config.make_flow(), PictureNoise.of(rest)
    first.set_reference(average(rest))
    measurers = [BlurredMeasurer(sigma_px, config.make_flow(), config.make_encoding()) for sigma_px in blur_px]
    for number, each in enumerate(measurers):
        each.use_reference(rest, first, noise, seed=len(measurers) * block.number + number)
    presses, seen = planned_presses(config.data, block.number, block.first, block.presses), []
    for press, seed in zip(presses, islice(seeds, frames, None), strict=False):
        image = cropped(config, optics.render((press,), seed))
        seen.append([each.measure(image) for each in measurers])
    places = [(each.x_mm, each.y_mm, each.depth_mm, table.force_at(each.depth_mm)) for each in presses]
    draft = block.file.with_suffix('.part.npz')
    np.savez(
        draft,
        presses=np.array(places, np.float32),
        sharp=sharpness(average(rest)),
        sharpness=[each.sharpness for each in measurers],
        features=np.array([[each.values for each in of_all] for of_all in seen], np.float16).swapaxes(0, 1),
        confidence=np.array([[each.confidence for each in of_all] for of_all in seen], np.float32).swapaxes(0, 1),
    )
    draft.replace(block.file)
    return block.presses


def _load(blocks: Sequence[Block], levels: int) -> tuple[BlurredPresses, ...]:
    loaded: list[dict[str, Any]] = []
    for block in blocks:
        with np.load(block.file) as arrays:
            loaded.append(dict(arrays))
    presses = np.concatenate([each['presses'] for each in loaded])
    sharp = float(np.mean([each['sharp'] for each in loaded]))
    made = []
    for level in range(levels):
        features, confidence = (
            np.concatenate([each[name][level] for each in loaded]) for name in ('features', 'confidence')
        )
        dataset = Dataset(features, presses, np.arange(len(presses)), confidence, 'blurred')
        sharpness_there = float(np.mean([each['sharpness'][level] for each in loaded]))
        made.append(BlurredPresses(sharp, sharpness_there, dataset))
    return tuple(made)
