"""One image with what each processing stage found in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.messages import types
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.moved_dots import MovedDots
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.picture.stillness import Stillness
from tactile_nodes.shapes import UInt8


@dataclass(slots=True)
class Frame:
    """The received image, and what each stage has found so far.

    `image` has its dead pixels filled in from `mend` on. `level` is its mean grey value. `reasons` are the reasons to
    doubt its force, as in a `ForceDistribution`. `registration` is the motion of the whole image; with
    printed dots, `dots` is.

    Set by `measure`: `straight` is the image registered to the rest image. `stillness` is the result of the stillness
    check, if it ran. `still` says that the frame was not measured because nothing moved. `banded` says that bands were
    removed. `motion` is what moved, found at `found_ns`.

    Set by `judge`: `changed` and `blurred` say that the image differs from the rest image, `odd` that dead pixels may
    be the cause, and `as_before` that it looks again as at the capture.
    """

    image: UInt8[np.ndarray, 'h w']
    head: types.Header
    at_ns: int
    reasons: int = 0
    level: float = 0.0
    straight: UInt8[np.ndarray, 'h w'] | None = None
    still: bool = False
    stillness: Stillness | None = None
    banded: bool = False
    registration: Registration | None = None
    dots: MovedDots | None = None
    motion: DisplacementField | None = None
    found_ns: int = 0
    features: Features | None = None
    untouched: bool = False
    changed: bool = False
    blurred: bool = False
    odd: bool = False
    as_before: bool = False
