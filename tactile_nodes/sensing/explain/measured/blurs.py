"""How a response changes as the picture blurs, as training measured it in pictures that it blurred itself.

Markers that run into each other show regions another mean of the same motion: small sharp ones lose weight, those near
the camera, which move less, keep it. No rest image tells that, and it is 1 to 3 % of a hard press. So a readout may
hold what its response becomes in pictures of a few sharpnesses; between them it goes over in straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float16, Float32

from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.uncertainty import Calibration

if TYPE_CHECKING:
    from tactile_nodes.sensing.explain.measured.readout import ResponseReadout


class QuickResponse(Response):
    """A response whose table to begin with is made axis by axis: in 5 ms, not 70, as a frame waits for it.

    (The same numbers but for their last digits, which those of sharp pictures shall keep.)
    """

    @cached_property
    def start_components(self) -> Float32[np.ndarray, 'starts components']:
        table = self.coefficients
        for number, axis in enumerate(self.axes):
            along = np.asarray(axis.design(np.unique(self.starts[:, number])), np.float32)
            table = np.moveaxis(np.tensordot(along, table, axes=(1, number)), 0, number)
        return np.ascontiguousarray(table.reshape(-1, table.shape[-1]), np.float32)


AS_SHARP = 0.005
"""Rest images of the same picture differ by less. Beside one a picture that is told blurred is a noisy one."""


@dataclass(frozen=True)
class Blur:
    """A response in pictures of one sharpness (that of their rest image, see `quality.sharpness`).

    `change` is what the coefficients have more than those of sharp pictures, in the components of these. `turning`
    makes of those components ones in which the noise of blurred pictures is 1 and what the splines miss grows by
    `growth`, as `whitening` does of scores. `floor` and `share` are the limits of what directions leave over.
    """

    sharpness: float
    change: Float16[np.ndarray, 'nx ny ns components']
    turning: Float32[np.ndarray, 'components components']
    growth: Float32[np.ndarray, ' components']
    calibration: Calibration
    floor: float
    share: float


@dataclass(frozen=True)
class Blurs:
    """What a readout knows of blurred pictures: the sharpness of its own, and responses in less and less sharp ones."""

    sharpness: float
    levels: tuple[Blur, ...]

    def readout(self, sharp: ResponseReadout, sharpness: float) -> ResponseReadout | None:
        """What reads motion beside a rest image of this sharpness; None where `sharp` does as it is.

        Beyond the last level it is that of the last. Noise, uncertainty and limits are those of the nearest level.
        """
        if not (math.isfinite(sharpness) and 0 < sharpness < self.sharpness - AS_SHARP):
            return None
        return _between(sharp, sharpness, [(self.sharpness, None), *((each.sharpness, each) for each in self.levels)])


def _between(sharp: ResponseReadout, sharpness: float, levels: list[tuple[float, Blur | None]]) -> ResponseReadout:
    """In straight lines between levels; None is what sharp pictures are read by."""
    place = float(np.interp(-sharpness, [-each for each, _ in levels], range(len(levels))))
    below = min(int(place), len(levels) - 2)
    part, change = place - below, np.zeros(sharp.response.coefficients.shape, np.float32)
    for (_, level), weight in zip(levels[below : below + 2], (1 - part, part), strict=True):
        if level is not None and weight > 0:
            change += np.float32(weight) * level.change.astype(np.float32)
    was = sharp.response
    response = QuickResponse(*was.axes, was.coefficients + change, was.growth, was.power)
    changed = replace(sharp.straight, blurs=None, response=response)
    nearest = levels[round(place)][1]
    return changed if nearest is None else _measured_like(changed, nearest)


def _measured_like(changed: ResponseReadout, blur: Blur) -> ResponseReadout:
    """With the noise, the uncertainty and the limits of a level."""
    coefficients = np.asarray(changed.response.coefficients @ blur.turning.T, np.float32)
    return replace(
        changed,
        whitening=np.asarray(blur.turning @ changed.whitening, np.float32),
        response=replace(changed.response, coefficients=coefficients, growth=blur.growth),
        calibration=blur.calibration,
        likeness=replace(changed.likeness, floor=blur.floor, share=blur.share),
    )
