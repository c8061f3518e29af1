"""A rest image with all that is computed of it before the first frame is measured beside it, and how it is measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.sensing.features import FeatureEncoding, Features, make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod, require_like
from tactile_nodes.sensing.picture.quality import MARKED_SHARE, require_rest_image
from tactile_nodes.sensing.picture.registration import Registered
from tactile_nodes.sensing.picture.rolling_bands import RollingBands
from tactile_nodes.sensing.picture.stillness import Stillness, StillnessCheck, StillnessOptions
from tactile_nodes.sensing.rest.reference import content_id

LEAST_CONFIDENT = 0.93
"""Share of the rest image's confidence in itself below which a frame is looked at for bands: presses leave 0.96."""


@dataclass(frozen=True)
class PreparedRest:
    """A rest image with all that is computed of it once; `own` is what the flow finds in itself."""

    image: UInt8[np.ndarray, 'h w']
    flow: FlowMethod
    encoding: FeatureEncoding
    check: StillnessCheck | None
    own: DisplacementField
    registering: Registered | None
    compiled: bool = False

    @cached_property
    def reference_id(self) -> str:
        """The name of the image, by its content."""
        return content_id(self.image)

    @cached_property
    def still(self) -> DisplacementField:
        """No motion, with the confidence that the rest image has in itself."""
        return DisplacementField(np.zeros_like(self.own.displacement_px), self.own.confidence)

    @cached_property
    def still_features(self) -> Features:
        """The features of no motion."""
        return self.encoding.encode(self.still)

    @cached_property
    def bands(self) -> RollingBands:
        """What finds bands beside it."""
        return RollingBands(self.image)

    @cached_property
    def least_sure(self) -> float:
        """Confidence, summed up, below which a frame is looked at for bands."""
        sure = self.own.confidence
        return 0.0 if sure is None else LEAST_CONFIDENT * float(sure.sum())

    def stillness(self, straight: UInt8[np.ndarray, 'h w']) -> Stillness | None:
        """How still a straightened frame is; None where nothing is there to tell."""
        return self.check.look(straight) if self.check is not None and self.check.able else None

    def features(self, image: UInt8[np.ndarray, 'h w']) -> Features:
        """The features of all that moved in an image, that of the camera included.

        Raises:
            ImageError: it has another size.
        """
        require_like(self.image, image)
        return self.encoding.encode(self.flow.displacement(image))


@dataclass(frozen=True)
class Measuring:
    """How motion is measured, and how it is summed up; `compiled`: by compiled loops.

    `check` says how frames are told in which nothing touches, whose motion is then zero without being measured.
    `registers`: the motion of the whole picture is taken out. `marked_share` of the regions must show structure in a
    rest image; sparse patterns need less.
    """

    flow: FlowMethod
    encoding: FeatureEncoding
    compiled: bool = False
    check: StillnessOptions | None = None
    registers: bool = False
    marked_share: float = MARKED_SHARE

    def beside(self, image: UInt8[np.ndarray, 'h w']) -> PreparedRest:
        """All that is computed of a rest image beforehand, some 0.1 s; in any thread.

        Raises:
            ImageError: it shows nothing that can be measured against.
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
