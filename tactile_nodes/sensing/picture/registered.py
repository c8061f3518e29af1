"""A rest image with what the registration of pictures needs of it, and motion on the registration's patches."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from tactile_nodes.sensing.features import fewer_means
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.motion import MotionFit

PATCHES = 10
FOUND = 0.4
"""Confidence from which a patch counts as found again."""

LEAST_SIDE_PX = 160
"""Side of the smallest picture that patches of our own are laid over."""


class Registered:
    """A rest image with what is computed of it once.

    `own` is what the flow finds in the rest image itself. Where it has fewer patches or does not say how sure it is,
    patches of our own are measured in every frame that is looked at.
    """

    def __init__(self, image: UInt8[np.ndarray, 'h w'], own: DisplacementField, *, compiled: bool = False) -> None:
        self.image = image
        self.fit = MotionFit(image.shape, PATCHES, PATCHES, compiled=compiled)
        self.watch = None
        seen = np.ones(PATCHES**2, bool)
        if own.confidence is None or min(own.confidence.shape) < PATCHES:
            self.watch = _watch(image, compiled)
            seen = seen if own.confidence is None else believed(own.confidence)
            own = self.watch.displacement(image) if self.watch else own
        self.confidence = coarse(own)[1] if own.confidence is not None else np.zeros(PATCHES**2)
        self.known = (self.confidence >= FOUND) & seen
        self.known_count = int(self.known.sum())


def _watch(image: UInt8[np.ndarray, 'h w'], compiled: bool) -> InverseCompositionalFlow | None:
    """Patches of our own at half size; None of a picture too small for them."""
    if min(image.shape) < LEAST_SIDE_PX:
        return None
    options = InverseCompositionalOptions(rows=PATCHES, cols=PATCHES, finest_scale=1)
    flow = InverseCompositionalFlow(options, compiled=compiled)
    flow.set_reference(image)
    return flow


def believed(confidence: Float[np.ndarray, 'rows cols']) -> Bool[np.ndarray, ' patches']:
    """Which of 10x10 patches lie where a method believes anything at all: it does not where the gel is covered."""
    rows, cols = (np.arange(PATCHES) * count // PATCHES for count in confidence.shape)
    found: np.ndarray = (confidence > 0)[np.ix_(rows, cols)]
    return found.ravel()


def coarse(field: DisplacementField) -> tuple[Float[np.ndarray, 'patches 2'], Float[np.ndarray, ' patches']]:
    """Motion of 10x10 patches and the confidence in it."""
    assert field.confidence is not None
    motion, confidence = field.displacement_px, field.confidence
    if confidence.shape != (PATCHES, PATCHES):
        motion, confidence = fewer_means(motion, confidence, PATCHES, PATCHES)
    return motion.reshape(-1, 2).astype(float), confidence.reshape(-1).astype(float)
