"""Novelty of a frame's features: the residual that the principal directions of the training cannot explain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS, Contact
from tactile_nodes.shapes import Float32

CLOSE_MM = 15.0
"""Least distance of tips, for readouts that know tips alone. They read another body, or a tip that presses deeper than
all in the training, as several tips close together. With 3 mm, `fast` would be up to 7 times its nominal error off
while ok, with 15 mm 2.2 times (`tactile bench contacts`)."""


def known(unlikeness: float, contacts: Sequence[Contact]) -> bool:
    """Whether a readout knows its error for such contacts; this also holds if their novelty is unknown (NaN)."""
    pressing = [(each.x_mm, each.y_mm) for each in contacts if each.force_n > 0]
    close = any(math.dist(*pair) < CLOSE_MM for pair in itertools.combinations(pressing, 2))
    return not close and not unlikeness >= BEYOND_UNLIKENESS


@dataclass(frozen=True)
class Likeness:
    """Principal directions of the training's inputs, and the usual residual.

    `directions` (components, inputs) are orthonormal. The residual of an input after mean and directions is compared
    with `floor` plus `share` times the input (root mean squares). One in a thousand of the presses held out in training
    exceeds this limit. The ratio is the novelty.
    """

    mean: Float32[np.ndarray, ' inputs']
    directions: Float32[np.ndarray, 'components inputs']
    floor: float
    share: float

    def unlikeness(self, inputs: Float32[np.ndarray, ' inputs']) -> float:
        """The novelty: 1 at the limit of the training; not finite for inputs that are not finite."""
        left, size = self.left_over(inputs)
        return left / (self.floor + self.share * size)

    def left_over(self, inputs: Float32[np.ndarray, ' inputs']) -> tuple[float, float]:
        """Root mean squares of the residual and of the input, both about the mean."""
        centred = inputs - self.mean
        squared = float(centred @ centred)
        known = self.directions @ centred
        left = max(squared - float(known @ known), 0.0)
        return float(np.sqrt(left / len(centred))), float(np.sqrt(squared / len(centred)))
