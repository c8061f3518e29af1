"""A rest image with all that is computed from it before the first frame, and the settings of the measurement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.features import FeatureEncoding, Features, make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.dots import DotsFlow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod, require_like
from tactile_nodes.sensing.picture.quality import MARKED_SHARE, require_rest_image
from tactile_nodes.sensing.picture.registration import Registered
from tactile_nodes.sensing.picture.rolling_bands import RollingBands
from tactile_nodes.sensing.picture.stillness import Stillness, StillnessCheck, StillnessOptions
from tactile_nodes.sensing.rest.reference import content_id
from tactile_nodes.shapes import UInt8

LEAST_CONFIDENT = 0.93
"""A frame below this share of the rest image's own confidence is checked for bands. Presses leave 0.96."""


@dataclass(frozen=True)
class PreparedRest:
    """A rest image with all that is computed from it once. `own` is the flow measured in the rest image itself."""

    image: UInt8[np.ndarray, 'h w']
    flow: FlowMethod
    encoding: FeatureEncoding
    check: StillnessCheck | None
    own: DisplacementField
    registering: Registered | None
    compiled: bool = False

    @cached_property
    def reference_id(self) -> str:
        """The id of the image, a hash of its content."""
        return content_id(self.image)

    @cached_property
    def still(self) -> DisplacementField:
        """Zero motion, with the confidence of the rest image in itself."""
        return DisplacementField(np.zeros_like(self.own.displacement_px), self.own.confidence)

    @cached_property
    def still_features(self) -> Features:
        """The features of zero motion."""
        return self.encoding.encode(self.still)

    @cached_property
    def own_features(self) -> Features:
        """The features of the rest image itself."""
        return self.encoding.encode(self.own)

    @cached_property
    def bands(self) -> RollingBands:
        """The detector of rolling bands relative to this image."""
        return RollingBands(self.image)

    @cached_property
    def least_sure(self) -> float:
        """Sum of the confidence below which a frame is checked for bands."""
        sure = self.own.confidence
        return 0.0 if sure is None else LEAST_CONFIDENT * float(sure.sum())

    def stillness(self, straight: UInt8[np.ndarray, 'h w']) -> Stillness | None:
        """How still a straightened frame is, or None if no check can tell."""
        return self.check.look(straight) if self.check is not None and self.check.able else None

    def features(self, image: UInt8[np.ndarray, 'h w']) -> Features:
        """The features of all motion in an image, camera motion included.

        Raises:
            ImageError: the image has another size.
        """
        require_like(self.image, image)
        return self.encoding.encode(self.flow.displacement(image))


@dataclass(frozen=True)
class Measuring:
    """How motion is measured and encoded. `compiled`: by compiled loops.

    `check` configures the detection of frames without contact, whose motion is set to zero without a measurement.
    `registers`: the motion of the whole picture is removed. `marked_share` of the regions must show structure in a
    rest image; sparse patterns need less.
    """

    flow: FlowMethod
    encoding: FeatureEncoding
    compiled: bool = False
    check: StillnessOptions | None = None
    registers: bool = False
    marked_share: float = MARKED_SHARE

    @property
    def follows_dots(self) -> bool:
        """Whether motion is that of printed dots."""
        return isinstance(self.flow, DotsFlow)

    def beside(self, image: UInt8[np.ndarray, 'h w']) -> PreparedRest:
        """Prepare a rest image. It takes some 0.1 s and can run in any thread.

        Raises:
            ImageError: no motion can be measured against this image.
        """
        encoding = make_encoding(self.encoding.name, self.encoding.options)
        encoding.set_reference(image)
        still = DisplacementField(np.zeros((*image.shape, 2), np.float32))
        require_rest_image(image, encoding.encode(still).confidence, self.marked_share)
        check = None if self.check is None else StillnessCheck(self.check, compiled=self.compiled)
        if check is not None:
            check.set_reference(image)
        flow = make_flow(self.flow.name, self.flow.options, compiled=self.compiled)
        flow.set_reference(image)
        own = flow.displacement(image)
        registering = Registered(image, own, compiled=self.compiled) if self.registers else None
        return PreparedRest(image, flow, encoding, check, own, registering, self.compiled)
