"""How unlike the training data a frame's features are: what the directions that presses take cannot explain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS, Contact

CLOSE_MM = 15.0
"""Tips that are nearer to each other do not just add up."""


def known(unlikeness: float, contacts: Sequence[Contact]) -> bool:
    """Whether a readout can say how far off it is of such contacts; where it does not know their unlikeness it can."""
    pressing = [(each.x_mm, each.y_mm) for each in contacts if each.force_n > 0 and each.region is None]
    close = any(math.dist(*pair) < CLOSE_MM for pair in itertools.combinations(pressing, 2))
    return not close and not unlikeness >= BEYOND_UNLIKENESS


@dataclass(frozen=True)
class Likeness:
    """Principal directions of the training's inputs, and how much is usually left over.

    `directions` (components, inputs) are orthonormal. What is left of an input beside its mean and these directions
    has, over presses held out in training, a root mean square of at most `floor` plus `share` times that of the input
    in all but one of a thousand; their quotient is the unlikeness.
    """

    mean: Float32[np.ndarray, ' inputs']
    directions: Float32[np.ndarray, 'components inputs']
    floor: float
    share: float

    def unlikeness(self, inputs: Float32[np.ndarray, ' inputs']) -> float:
        """1 at the limit of what training held; not finite for inputs that are not."""
        left, size = self.left_over(inputs)
        return left / (self.floor + self.share * size)

    def left_over(self, inputs: Float32[np.ndarray, ' inputs']) -> tuple[float, float]:
        """Root mean square of what the directions leave over, and of the whole, both about the mean."""
        centred = inputs - self.mean
        whole = float(centred @ centred)
        known = self.directions @ centred
        left = max(whole - float(known @ known), 0.0)
        return float(np.sqrt(left / len(centred))), float(np.sqrt(whole / len(centred)))
