"""Published flow methods with our interface, only for benchmarks.

None of them is shipped: the chart shows the accuracy and cost of each. All options are OpenCV's defaults unless stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod, require_grey, require_like
from tactile_nodes.sensing.flow.patches import shrunk

Calculation = Callable[[np.ndarray, np.ndarray], np.ndarray]


class DenseFlow:
    """A method that gives the motion of each pixel, at full size or on images halved `halvings` times."""

    def __init__(self, name: str, calculate: Calculation, halvings: int = 0) -> None:
        self.name, self._calculate, self._halvings = name, calculate, halvings
        self._full: np.ndarray | None = None
        self._rest: np.ndarray

    @property
    def options(self) -> dict[str, object]:
        return {'halvings': self._halvings}

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        self._full, self._rest = image.copy(), np.ascontiguousarray(shrunk(image, self._halvings))

    def displacement(self, image: np.ndarray) -> DisplacementField:
        require_like(self._full, image)
        flow = self._calculate(self._rest, np.ascontiguousarray(shrunk(image, self._halvings)))
        return _enlarged(np.asarray(flow, np.float32), image.shape, self._halvings)


class OtherFlow:
    """One of our methods on halved images."""

    def __init__(self, flow: FlowMethod) -> None:
        self._flow, self.name = flow, f'{flow.name}, halved'

    @property
    def options(self) -> dict[str, object]:
        return {**self._flow.options, 'halvings': 1}

    def set_reference(self, image: np.ndarray) -> None:
        self._flow.set_reference(shrunk(image))

    def displacement(self, image: np.ndarray) -> DisplacementField:
        return _enlarged(self._flow.displacement(shrunk(image)).displacement_px, image.shape, 1)


def _enlarged(flow: np.ndarray, shape: tuple[int, ...], halvings: int) -> DisplacementField:
    """The field of a halved image at full size, because 20 or 40 regions do not divide 220 or 110 pixels."""
    if halvings == 0:
        return DisplacementField(flow)
    full = cv2.resize(flow, shape[::-1], interpolation=cv2.INTER_LINEAR)
    return DisplacementField(full * np.float32(2**halvings))


def farneback(rest: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Polynomial expansion (Farneback, SCIA 2003), as in OpenCV's example: three levels, windows of 15 px."""
    flow: np.ndarray = cv2.calcOpticalFlowFarneback(rest, image, None, 0.5, 3, 15, 3, 5, 1.2, 0)  # type: ignore[call-overload]
    return flow


def tv_l1(rest: np.ndarray, image: np.ndarray) -> np.ndarray:
    """TV-L1 (Zach et al., DAGM 2007; Sanchez et al., IPOL 2013)."""
    flow: np.ndarray = cv2.optflow.createOptFlow_DualTVL1().calc(rest, image, None)  # type: ignore[call-overload]
    return flow


class _Grid:
    """Centres of rows x cols regions of the rest image, and windows around them."""

    name = ''

    def __init__(self, regions: int, window: float, least_px: int = 0) -> None:
        self._regions, self._window, self._least_px = regions, window, least_px
        self._rest: np.ndarray | None = None
        self._side = 0
        self._centres: np.ndarray

    @property
    def options(self) -> dict[str, object]:
        return {'regions': self._regions, 'window_px': self._side}

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        self._rest = image.copy()
        along = [(np.arange(self._regions) + 0.5) * side / self._regions - 0.5 for side in image.shape[::-1]]
        self._centres = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 2).astype(np.float32)
        self._side = max(self._least_px, round(self._window * max(image.shape) / self._regions))

    def _field(self, motion: np.ndarray, found: np.ndarray) -> DisplacementField:
        shape = self._regions, self._regions
        motion = np.where(found[:, None], motion, 0).astype(np.float32)
        return DisplacementField(motion.reshape(*shape, 2), found.astype(np.float32).reshape(shape))


class PyramidalLk(_Grid):
    """Lucas-Kanade in a pyramid of four levels (Bouguet 2001) at the centre of each region."""

    name = 'pyramidal_lk'

    def displacement(self, image: np.ndarray) -> DisplacementField:
        rest = require_like(self._rest, image)
        side = self._side, self._side
        points, found, _ = cv2.calcOpticalFlowPyrLK(rest, image, self._centres, None, winSize=side, maxLevel=3)  # type: ignore[call-overload]
        return self._field(points.reshape(-1, 2) - self._centres, found.reshape(-1) > 0)


class PhaseCorrelation(_Grid):
    """Phase correlation around each region's centre, with a Hann window."""

    name = 'phase_correlation'

    def set_reference(self, image: np.ndarray) -> None:
        super().set_reference(image)
        side = self._side = min(self._side, *image.shape)
        corner = np.clip(np.rint(self._centres - side / 2), 0, np.array(image.shape[::-1]) - side).astype(int)
        self._corners = corner.tolist()
        self._hann = cv2.createHanningWindow((side, side), cv2.CV_32F)
        full = image.astype(np.float32)
        self._patches = [np.ascontiguousarray(full[y : y + side, x : x + side]) for x, y in self._corners]

    def displacement(self, image: np.ndarray) -> DisplacementField:
        require_like(self._rest, image)
        full, side = image.astype(np.float32), self._side
        motion = [
            cv2.phaseCorrelate(rest, np.ascontiguousarray(full[y : y + side, x : x + side]), self._hann)[0]
            for rest, (x, y) in zip(self._patches, self._corners, strict=True)
        ]
        return self._field(np.array(motion), np.ones(len(motion), bool))


@dataclass
class SmallPixels:
    """No motion: the change of each region's brightness from the rest image."""

    regions: int

    def set_reference(self, image: np.ndarray) -> None:
        self._rest = self._small(image)
        self._sure = np.ones((self.regions, self.regions), np.float32)

    def __call__(self, image: np.ndarray) -> Features:
        return Features('small_pixels', (self._small(image) - self._rest)[:, :, None], self._sure)

    def _small(self, image: np.ndarray) -> np.ndarray:
        small: np.ndarray = cv2.resize(
            image.astype(np.float32), (self.regions, self.regions), interpolation=cv2.INTER_AREA
        )
        return small
