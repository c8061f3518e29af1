"""Motion beside one rest image taken for what another one would have shown, where it is known how far each spot goes.

`texture_places` does so by slopes, for any model. With the gains of the texture (`texture_gains`) more can be told: a
patch finds the mean of what its spots do, weighed by their edges, and both rest images tell the weights. So what it
finds of any motion follows from them, and all of it is linear in the motion, which is told by patches no further apart
than contacts are wide: the flow's own, or finer ones.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod
from tactile_nodes.sensing.picture.quality import REST_BLURRED_OFF, sharpness
from tactile_nodes.sensing.rest.texture_gains import PATCH_PX, TextureGains, fine_flow
from tactile_nodes.sensing.rest.texture_places import LEAST_KNOWN

NEAR = 1.2
"""A flow's own patches tell the motion of the gel where they are no further apart than this, in fine ones."""

MOST_GAIN = 0.4
"""Patches that find so much more or less than even motion hold spots of one depth alone, or hardly any."""

CLIPPED_GREY, AROUND_PX, LEAST_SHARE = 250, 8.0, 0.05
SPOT = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
"""Spots that lie upon each other are the brightest ones. They change their shape as one goes further than the other,
and where the camera cuts that off their gains mean nothing."""

RestImage = tuple[FlowMethod, UInt8[np.ndarray, 'h w']]
"""A flow and the rest image that it measures against."""


class KnownTexture:
    """Takes motion found beside one rest image for what it would have been beside another of the same gel.

    Args:
        now: the flow that motion is found by.
        first: the same beside the other rest image.
        told: motion of the gel is told by these patches, beside the rest image in use.
        gains: of the texture, where both rest images have it.
    """

    def __init__(
        self,
        now: InverseCompositionalFlow,
        first: InverseCompositionalFlow,
        told: InverseCompositionalFlow,
        gains: Float32[np.ndarray, 'h w'],
    ) -> None:
        self.finer: FlowMethod | None = told if told is not now else None
        known = np.repeat(np.minimum(now.known, first.known).reshape(-1) >= LEAST_KNOWN, 2)
        apart = first.answers_to(gains, *told.known.shape) - now.answers_to(gains, *told.known.shape)
        apart[~known] = 0
        by_node = apart.reshape(len(apart), -1, 1, 2) @ _smooth(told, gains)
        self._apart: Float32[np.ndarray, 'found told'] = np.ascontiguousarray(by_node.reshape(apart.shape), np.float32)

    def as_first(self, field: DisplacementField, told: DisplacementField) -> DisplacementField:
        """The motion as the first rest image's texture would have shown it.

        `told` is what the `finer` flow found, or the field itself where there is none.
        """
        motion = field.displacement_px
        off: np.ndarray = (self._apart @ told.displacement_px.reshape(-1)).reshape(motion.shape)
        return DisplacementField(motion + off, field.confidence)


def _smooth(told: InverseCompositionalFlow, gains: Float32[np.ndarray, 'h w']) -> Float32[np.ndarray, 'patches 2 2']:
    """What takes motion that patches found for that of the gel around their spots; as it is where that is another."""
    found, even = told.answers_even(gains), np.eye(2, dtype=np.float32)
    like = (told.known.reshape(-1) >= LEAST_KNOWN) & (np.abs(found - even).max(axis=(1, 2)) <= MOST_GAIN)
    smooth: np.ndarray = np.linalg.inv(np.where(like[:, None, None], found, even))
    return smooth


def known_texture(texture: TextureGains, now: RestImage, first: RestImage) -> KnownTexture | None:
    """Between two rest images of one gel, the second captured, the first one renewed; made beside the frames.

    None where no patches tell, where the texture is that of another gel, and where the picture has become blurred:
    spots run into each other there.
    """
    (flow, image), (first_flow, first_image) = now, first
    if not (isinstance(flow, InverseCompositionalFlow) and isinstance(first_flow, InverseCompositionalFlow)):
        return None
    if sharpness(image) - sharpness(first_image) < REST_BLURRED_OFF:
        return None
    there = texture.beside(first_image)
    if there is None:
        return None
    rows, cols = flow.known.shape
    near = max(image.shape[0] / rows, image.shape[1] / cols) <= NEAR * PATCH_PX
    told = _as_around(there, (image >= CLIPPED_GREY) & (first_image < CLIPPED_GREY))
    return KnownTexture(flow, first_flow, flow if near else fine_flow(image), told)


def _as_around(gains: Float32[np.ndarray, 'h w'], bright: Bool[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
    """Gains with spots that have become too bright for the camera taken for those around them."""
    clipped = cv2.dilate(bright.astype(np.uint8), SPOT) > 0
    sure = 1 - clipped.astype(np.float32)
    near, share = (cv2.GaussianBlur(each, (0, 0), AROUND_PX) for each in (gains * sure, sure))
    told: np.ndarray = np.where(clipped, near / np.maximum(share, LEAST_SHARE), gains).astype(np.float32)
    return told
