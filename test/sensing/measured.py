"""Frames measured beside one rest image as the pipeline measures them."""

from __future__ import annotations

import numpy as np

from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.pipeline.measure import MeasureMemory, measure
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.picture.quality import PictureLikeness
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.stillness import StillnessOptions
from tactile_nodes.sensing.rest.in_use import RestInUse
from tactile_nodes.sensing.rest.prepared import Measuring


class Measured:
    """By one flow, on 10x10 regions; without its options one that measures by as many patches, at half size."""

    def __init__(
        self,
        rest: np.ndarray,
        method: str = 'inverse_compositional',
        *,
        regions: int = 10,
        registration: Registration | None = None,
        check: StillnessOptions | None = None,
    ) -> None:
        patches = {'rows': regions, 'cols': regions, 'finest_scale': 1}
        flow = make_flow(method, patches if method == 'inverse_compositional' else {})
        encoding = make_encoding('cartesian_mean', {'rows': regions, 'cols': regions})
        self.rest = Measuring(flow, encoding, check=check, registers=registration is not None).beside(rest)
        likeness = PictureLikeness.of(rest, method)
        self._memory = MeasureMemory(registration)
        self._memory.begin(RestInUse(self.rest, likeness, likeness))

    def __call__(self, image: np.ndarray, at_ns: int = 0) -> Frame:
        """What is found of a frame."""
        frame = Frame(image, types.Header(), at_ns)
        measure(self._memory, self.rest, frame)
        return frame
