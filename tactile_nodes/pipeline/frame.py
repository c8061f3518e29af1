"""One picture on its way from the camera's message to the message of its features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.messages import types
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.stillness import Stillness


@dataclass(slots=True)
class Frame:
    """What came, and what each stage has found of it so far.

    `image` has its dead pixels filled in from `mend` on; `level` is its mean grey. `reasons` are what speaks against
    its force, as in a `ForceDistribution`. `registration` is what is known of the whole picture's motion. From
    `measure`: `straight` is the image where the rest image has it, `seen` how still it is, if that was looked at,
    `still` whether it was not measured for that, `banded` whether bands were taken out, and `motion` what moved, found
    at `found_ns`. From `judge`: `changed` and `blurred` say that it is another picture than the rest image, `odd` that
    it may be so by dead pixels, `as_before` that it is again as at the capture.
    """

    image: UInt8[np.ndarray, 'h w']
    head: types.Header
    at_ns: int
    reasons: int = 0
    level: float = 0.0
    straight: UInt8[np.ndarray, 'h w'] | None = None
    still: bool = False
    seen: Stillness | None = None
    banded: bool = False
    registration: Registration | None = None
    motion: DisplacementField | None = None
    found_ns: int = 0
    features: Features | None = None
    untouched: bool = False
    changed: bool = False
    blurred: bool = False
    odd: bool = False
    as_before: bool = False
