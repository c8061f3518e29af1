"""Markers at random in a picture judged beside those described: tone, number, width, and where they end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK, Finding, percent, tone
from tactile_nodes.sensing.inspection.texture import mark_px, marks, peaks

CLEAR = 0.5
"""Skewness of the light of marks from which they are surely bright, or below minus that dark: simulated, 1.3 to 1.7."""

MOST_PEAKS = 0.03
"""Peaks a pixel that are told apart however many markers there are: 0.028 to 0.031 on the three that are simulated."""

OTHER, WHOLLY_OTHER = 2.5, 8.0
"""Times as many markers as described, or as few, that call for a look; and that are another pattern."""

BLURRED, NARROW = 1.6, 0.7
"""Times as wide as described ones are in a sharp picture: marks out of focus, and marks of something smaller."""

LENS_PX = 0.6
"""Blur of a good lens and its pixels beside their size (standard deviation)."""

BESIDE, AS_MANY, MUCH = 0.03, 0.5, 0.5
"""Of the picture's width: how far the rim may be off. Of the markers on the gel: how many beside it are a pattern that
goes on. Of the picture: how much of that shows something else than is described."""

LEAST_BESIDE = 0.05
"""Of the picture: what is judged beside the gel."""

CHECK = 'check camera.position_mm, its focal length, gel.width_mm and the pattern'


@dataclass(frozen=True)
class Markers:
    """Markers of a picture. `gel` is where the picture should show gel, `beside` where it should show none."""

    view: View
    rest: UInt8[np.ndarray, 'h w']
    gel: Bool[np.ndarray, 'h w']
    beside: Bool[np.ndarray, 'h w']

    @cached_property
    def peaks(self) -> Bool[np.ndarray, 'h w']:
        """Single markers, of the tone that is described."""
        return peaks(self.rest, dark=self.view.sensor.pattern.dark)

    def pattern(self, in_region: int) -> Finding:
        """Whether tone and number are as described, and enough for regions that have so many each."""
        pattern = self.view.sensor.pattern
        if not self.gel.any():
            return Finding('pattern', BAD, f'no gel is visible: {CHECK}')
        skew = self._skewness
        if abs(skew) > CLEAR and (skew < 0) != pattern.dark:
            told = f'markers are {tone(skew < 0)}, but the description says {tone(pattern.dark)}: set pattern.dark'
            return Finding('pattern', BAD, told)
        per_mm2, found = self.view.px_per_mm**2, float(self.peaks[self.gel].mean())
        expected = self._expected
        told = (
            f'{in_region} markers per region (median), {found * per_mm2:.3g} per mm² found and '
            f'{expected * per_mm2:.3g} expected from the description'
        )
        times = max(found, 1e-9) / expected
        if in_region < 1 or not 1 / WHOLLY_OTHER < times < WHOLLY_OTHER:
            return Finding('pattern', BAD, told if in_region < 1 else f'{told}: {CHECK}')
        if not 1 / OTHER < times < OTHER:
            return Finding('pattern', LOOK, f'{told}: {CHECK}')
        return Finding('pattern', LOOK if in_region < 2 else OK, told)

    def focus(self) -> Finding:
        """Whether marks are as wide as those described are where they are sharp."""
        wide, sharp = mark_px(self.rest, self.gel), self._sharp_px
        told = f'marks are {wide:.1f} px wide (standard deviation), {sharp:.1f} where they are sharp'
        if wide < NARROW * sharp:
            return Finding('focus', LOOK, f'{told}, smaller than described: {CHECK}')
        if wide > BLURRED * sharp:
            return Finding('focus', LOOK, f'{told}; turn the lens until they are narrowest, or {CHECK}')
        return Finding('focus', OK, told)

    def beyond(self) -> str:
        """That the pattern goes on where the gel should have ended; empty: it does not, or nothing is seen there."""
        share = float(self.beside.mean())
        if share < LEAST_BESIDE or not self.gel.any():
            return ''
        if self.peaks[self.beside].mean() < AS_MANY * self.peaks[self.gel].mean():
            return ''
        return f'{percent(share)} of the image show the pattern outside the described gel: {CHECK}'

    @property
    def much_beyond(self) -> bool:
        """Whether most of the picture shows what is not described."""
        return bool(self.beyond()) and bool(self.beside.mean() > MUCH)

    @property
    def _skewness(self) -> float:
        light = marks(self.rest)[self.gel].astype(float)
        return float((light**3).mean() / max(float(np.square(light).mean()), 1e-9) ** 1.5)

    @property
    def _expected(self) -> float:
        """Peaks a pixel: of many markers, those near each other are one."""
        gel, pattern = self.view.sensor.gel, self.view.sensor.pattern
        markers = pattern.count / (gel.width_mm * gel.height_mm) / self.view.px_per_mm**2
        return markers / (1 + markers / MOST_PEAKS)

    @property
    def _sharp_px(self) -> float:
        """Width of described markers under a good lens: a disc's variance is a quarter of its squared radius."""
        return math.sqrt(self.view.marker_radius_px**2 / 4 + 1 / 12 + LENS_PX**2)


def beside(within: Bool[np.ndarray, 'h w']) -> Bool[np.ndarray, 'h w']:
    """What is surely beside a part of a picture."""
    reach = 2 * math.ceil(BESIDE * within.shape[1]) + 1
    return np.asarray(cv2.dilate(within.astype(np.uint8), np.ones((reach, reach), np.uint8)) == 0)
