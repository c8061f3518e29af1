"""How unlike the training data a frame's features are: what the directions that presses take cannot explain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from tactile_nodes.sensing.reading import Contact

LIKE = {'response': 0.6}
"""Unlikeness up to which a readout of a kind is as good as in training; 1 of the others.

A response is a sharper test than what networks learned from: of 80 presses at random places it calls 76 less unlike.
Tips of other shapes (0.5 to 0.9), a drag of 0.1 mm (0.6 to 1.5) and presses at the rim of the training lie above it.
"""

CLOSE_MM = 15.0
"""Contacts that are nearer to each other do not just add up."""


def alike(kind: str, unlikeness: float, contacts: Sequence[Contact]) -> bool:
    """Whether a readout of a kind knows such contacts from its training; where it cannot tell it does."""
    pressing = [(each.x_mm, each.y_mm) for each in contacts if each.force_n > 0]
    close = any(math.dist(*pair) < CLOSE_MM for pair in itertools.combinations(pressing, 2))
    return not close and not unlikeness > (LIKE.get(kind, 1.0) if pressing else 1.0)


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
