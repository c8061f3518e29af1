"""Where in its region a patch reads motion: where its texture is. Of another texture that is another place.

A patch finds the mean of what its markers do, weighed by their edges. Where markers are gone, drowned in light or run
into each other, it finds the mean over others, and where motion changes across the patch that is another motion. To the
first order the two rest images tell by how much: each patch's answer to an even slope of motion, times the slope.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Float32

from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod

LEAST_PX = 0.06
"""Root mean square of what answers to slopes are apart, from which it is another texture: two rest images of the same
picture are 0.025 px apart, one with light of 1.3 times as much 0.13 and more, one with a tenth of its markers gone 0.4.
"""

LEAST_KNOWN = 0.5
"""Patches that texture lets be found less surely than this, and those beside them, are left as they are."""


LEAST_FOUND = 0.2
"""Motion of patches that are found less surely than this in a frame makes no slopes."""

STEEP_PX = 1.0
"""Where motion changes by so much from the middle of a patch to its rim, half of what the first order says is believed:
markers that go further than they are wide from where the rest of a patch goes no longer count in it."""

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


class OtherTexture:
    """Takes motion found beside one rest image for what it would have been beside another of the same gel.

    Args:
        answers: what each patch answers to slopes of motion of 1 px per px (motion right along right and down, motion
            down along right and down), in px, beside the rest image in use.
        first: the same beside the other one.
        known: how surely patches are found by their texture, the less of both.
        shape: of the image.
    """

    def __init__(
        self,
        answers: Float32[np.ndarray, 'rows cols 2 4'],
        first: Float32[np.ndarray, 'rows cols 2 4'],
        known: Float32[np.ndarray, 'rows cols'],
        shape: tuple[int, ...],
    ) -> None:
        # Slopes are told by the patches beside.
        sure = cv2.erode((known >= LEAST_KNOWN).astype(np.uint8), _CROSS, borderValue=1) > 0
        apart = np.where(sure[:, :, None, None], answers - first, np.float32(0))
        self.apart_px = math.sqrt(float(np.square(apart[sure]).mean())) if sure.any() else 0.0
        rows, cols = known.shape
        per_px = np.array([cols / shape[1], rows / shape[0]] * 2, np.float32)
        self._apart = apart * per_px

    @property
    def differs(self) -> bool:
        """Whether it is another texture at all, and not the same with other noise."""
        return self.apart_px > LEAST_PX

    def as_first(self, field: DisplacementField) -> DisplacementField:
        """The motion as the first rest image's texture would have shown it."""
        motion = field.displacement_px
        right, down = sloping(motion, 1), sloping(motion, 0)
        slopes = np.stack([right[:, :, 0], down[:, :, 0], right[:, :, 1], down[:, :, 1]], axis=-1)
        steep = np.square(slopes).sum(axis=-1, keepdims=True) / (2 * STEEP_PX) ** 2
        off: np.ndarray = np.matmul(self._apart, slopes[:, :, :, None])[:, :, :, 0] / (1 + steep)
        if field.confidence is not None:
            off[cv2.erode(field.confidence, _CROSS, borderValue=1) < LEAST_FOUND] = 0
        return DisplacementField(motion - off, field.confidence)


def other_texture(now: FlowMethod, first: FlowMethod | None, shape: tuple[int, ...]) -> OtherTexture | None:
    """Between the rest image of one flow and that of another; None where it is the same texture, or no patches tell."""
    if not (isinstance(now, InverseCompositionalFlow) and isinstance(first, InverseCompositionalFlow)):
        return None
    other = OtherTexture(now.answers, first.answers, np.minimum(now.known, first.known), shape)
    return other if other.differs else None


def sloping(values: Float32[np.ndarray, 'rows cols 2'], axis: int) -> Float32[np.ndarray, 'rows cols 2']:
    """Change per patch along an axis, of four neighbours where there are as many: a polynomial of the fourth degree.

    Two neighbours make less of the slopes beside a contact, which is not much wider than they are apart.
    """
    along = np.moveaxis(values, axis, 0)
    slope = np.gradient(along, axis=0) if len(along) > 1 else np.zeros_like(along)
    if len(along) > 4:
        slope[2:-2] = (8 * (along[3:-1] - along[1:-3]) - (along[4:] - along[:-4])) / 12
    back: np.ndarray = np.moveaxis(slope, 0, axis).astype(np.float32)
    return back
