"""A rest image with all that is computed of it before the first frame is measured beside it, and how it is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.sensing.features import FeatureEncoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod
from tactile_nodes.sensing.picture.registered import Registered
from tactile_nodes.sensing.picture.stillness import StillnessCheck


@dataclass(frozen=True)
class Measuring:
    """How motion is measured, and how it is summed up; `compiled`: by compiled loops."""

    flow: FlowMethod
    encoding: FeatureEncoding
    compiled: bool = False

    def flow_beside(self, image: UInt8[np.ndarray, 'h w']) -> FlowMethod:
        """A flow of this kind that measures against an image."""
        flow = make_flow(self.flow.name, self.flow.options, compiled=self.compiled)
        flow.set_reference(image)
        return flow


@dataclass(frozen=True)
class PreparedRest:
    """A rest image with all that is computed of it once; `own` is what the flow finds in itself."""

    image: UInt8[np.ndarray, 'h w']
    flow: FlowMethod
    encoding: FeatureEncoding
    check: StillnessCheck | None
    own: DisplacementField
    registering: Registered | None
