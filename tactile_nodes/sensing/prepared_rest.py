"""A rest image with all that is computed of it before the first frame is measured beside it, and how it is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.sensing.features import FeatureEncoding
from tactile_nodes.sensing.flow import DisplacementField, FlowMethod, make_flow
from tactile_nodes.sensing.known_texture import KnownTexture
from tactile_nodes.sensing.registered import Registered
from tactile_nodes.sensing.stillness import StillnessCheck
from tactile_nodes.sensing.texture_gains import TextureGains


@dataclass(frozen=True)
class Measuring:
    """How motion is measured, how it is summed up, and how far each spot of the gel goes, where that is known."""

    flow: FlowMethod
    encoding: FeatureEncoding
    texture: TextureGains | None = None

    def flow_beside(self, image: UInt8[np.ndarray, 'h w']) -> FlowMethod:
        """A flow of this kind that measures against an image."""
        flow = make_flow(self.flow.name, self.flow.options)
        flow.set_reference(image)
        return flow


@dataclass(frozen=True)
class PreparedRest:
    """A rest image with all that is computed of it once; `own` is what the flow finds in itself, `known`
    takes motion beside it for that beside the first one. `finer`: motion is measured by the finer way."""

    image: UInt8[np.ndarray, 'h w']
    flow: FlowMethod
    encoding: FeatureEncoding
    check: StillnessCheck | None
    own: DisplacementField
    registering: Registered | None
    known: KnownTexture | None = None
    finer: bool = False
