"""How far each spot of a gel's texture goes beside the motion around it, as presses showed it.

Markers near the skin go with what presses, those near the camera hardly move, and every region has some of all depths:
of the simulated gel single spots go a third further or less than the rest (`tactile model info fast`). A patch finds
the mean over its spots, so another one where some of them are gone. Which spots go how far, a rest image does not tell.
Presses do: a picture moved back by the smooth motion that patches found is the rest image, but for what single spots
went further. To the first order that is the gradient of the rest image times the motion, times the spot's gain; least
squares over all presses give it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.picture.change import PictureChange, PictureComparison

SPOT_PX = 0.6
"""Standard deviation of the Gaussian that pixels are averaged by. Spots are some 3 px wide and lie half upon each
other: averaged by as much as they are wide, forces are further off where some of them are gone."""

LEAST_POWER = 0.1
"""Of what the middle spot shows, which every spot is granted of no gain at all: what shows little is not believed."""

LEAST_MOTION_PX = 0.15
"""Less motion tells more of noise than of gains."""

PATCH_PX = 22
"""Distance of the patches by which smooth motion is found; contacts are not much wider."""

MOVED_PX, MOST_MOVED_PX = 0.25, 8.0
"""A picture that lies further off is moved by whole its motion; beyond the other it is not the one that was learned."""


@dataclass(frozen=True)
class TextureGains:
    """`gains`: by which share of the motion around it each pixel's texture goes further; `picture`: the rest image."""

    gains: Float32[np.ndarray, 'h w']
    picture: UInt8[np.ndarray, 'h w']

    @property
    def told(self) -> str:
        """In words, how far apart spots go."""
        spread = float(np.std(self.gains[self.gains != 0])) if self.gains.any() else 0.0
        return f'single spots go {spread:.0%} (root mean square) further or less than what is around them'

    def beside(self, rest: UInt8[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w'] | None:
        """The gains where another rest image has its texture; None if that shows another gel, or is another cut."""
        if rest.shape != self.picture.shape:
            return None
        try:
            change = PictureComparison(self.picture).of(rest)
        except ImageError:
            return None
        if not (change.same and change.size_px <= MOST_MOVED_PX):
            return None
        return self.gains if change.size_px < MOVED_PX else _moved(self.gains, change)


def _moved(values: Float32[np.ndarray, 'h w'], change: PictureChange) -> Float32[np.ndarray, 'h w']:
    """Values of places that moved, turned and grew as a picture did."""
    height, width = values.shape
    turn = math.radians(change.turn_deg)
    linear = np.array([[1 + change.growth, -turn], [turn, 1 + change.growth]])
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    there = np.column_stack([linear, middle + change.shift_px - linear @ middle])
    moved: np.ndarray = cv2.warpAffine(values, there, (width, height), flags=cv2.INTER_LINEAR)
    return moved


class GainsMeasurement:
    """Takes pictures of presses, one after another, that belong to one rest image.

    Raises:
        ImageError: the rest image is too small to measure motion by.
    """

    def __init__(self, rest: UInt8[np.ndarray, 'h w']) -> None:
        self._picture, self._flow = rest, fine_flow(rest)
        self._still = rest.astype(np.float32)
        self._right: Float32[np.ndarray, 'h w'] = np.gradient(self._still, axis=1)
        self._down: Float32[np.ndarray, 'h w'] = np.gradient(self._still, axis=0)
        self._across, self._along = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in rest.shape[::-1]))
        self._seen = np.zeros(rest.shape)
        self._power = np.zeros(rest.shape)

    def add(self, image: UInt8[np.ndarray, 'h w']) -> None:
        """A picture in which something presses."""
        motion = cv2.resize(
            self._flow.displacement(image).displacement_px, self._still.shape[::-1], interpolation=cv2.INTER_CUBIC
        )
        right, down = motion[:, :, 0], motion[:, :, 1]
        back = cv2.remap(
            image.astype(np.float32), self._across + right, self._along + down, cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip
        shown = self._right * right + self._down * down
        shown[right * right + down * down < LEAST_MOTION_PX**2] = 0
        self._seen += (self._still - back) * shown
        self._power += shown * shown

    def gains(self) -> TextureGains:
        """What all pictures told."""
        seen, power = (cv2.GaussianBlur(each, (0, 0), SPOT_PX) for each in (self._seen, self._power))
        told = power > 0
        granted = LEAST_POWER * float(np.median(power[told])) if told.any() else 1.0
        return TextureGains((seen / (power + granted)).astype(np.float32), self._picture)


def fine_flow(rest: UInt8[np.ndarray, 'h w']) -> InverseCompositionalFlow:
    """Motion by patches as near to each other as contacts are wide, ready for pictures.

    Raises:
        ImageError: the rest image is too small.
    """
    rows, cols = (max(1, round(side / PATCH_PX)) for side in rest.shape)
    flow = InverseCompositionalFlow(InverseCompositionalOptions(rows=rows, cols=cols))
    flow.set_reference(rest)
    return flow
