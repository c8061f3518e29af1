"""Checks random markers in a picture against the description: tone, number, width, and extent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK, Finding, percent, tone
from tactile_nodes.sensing.inspection.texture import mark_px, marks, peaks
from tactile_nodes.shapes import Bool, UInt8

CLEAR = 0.5
"""Skewness above which markers are surely bright, or below its negative dark. Simulated markers have 1.3 to 1.7."""

MOST_PEAKS, MOST_MERGED = 0.03, 0.75
"""Largest number of distinct peaks per pixel, for any number of markers: 0.028 to 0.031 on the three simulated. Beyond
the second, as a share of it, peaks do not tell how many markers there are."""

OTHER, WHOLLY_OTHER = 2.5, 8.0
"""Ratio of found to described markers, or its inverse, that needs a check, and that means another pattern."""

BLURRED, NARROW = 1.6, 0.7
"""Ratio to the described width in a sharp picture: above it marks are out of focus, below the other too small."""

LENS_PX = 0.6
"""Blur of a good lens, in addition to the pixel size (standard deviation)."""

BESIDE, AS_MANY, MUCH = 0.03, 0.5, 0.5
"""Allowed error of the rim, over the picture's width; relative density of markers outside the gel from which the
pattern extends there; share of the picture outside the gel from which the description is wrong."""

LEAST_BESIDE = 0.05
"""Least share of the picture outside the gel for a judgement."""

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
        """Single markers of the described tone."""
        return peaks(self.rest, dark=self.view.sensor.pattern.dark)

    def pattern(self, in_region: int) -> Finding:
        """Whether tone and number are as described, and `in_region` markers per region are enough."""
        pattern = self.view.sensor.pattern
        if not self.gel.any():
            return Finding('pattern', BAD, f'no gel is visible: {CHECK}')
        skew = self._skewness
        if abs(skew) > CLEAR and (skew < 0) != pattern.dark:
            text = f'markers are {tone(skew < 0)}, but the description says {tone(pattern.dark)}: set pattern.dark'
            return Finding('pattern', BAD, text)
        per_mm2, found = self.view.px_per_mm**2, float(self.peaks[self.gel].mean())
        expected = self._expected
        text = (
            f'{in_region} markers per region (median), {found * per_mm2:.3g} per mm² found and '
            f'{expected * per_mm2:.3g} expected from the description'
        )
        times = max(found, 1e-9) / expected
        if in_region < 1 or not 1 / WHOLLY_OTHER < times < WHOLLY_OTHER:
            return Finding('pattern', BAD, text if in_region < 1 else f'{text}: {CHECK}')
        if not 1 / OTHER < times < OTHER:
            return Finding('pattern', LOOK, f'{text}: {CHECK}')
        return Finding('pattern', LOOK if in_region < 2 else OK, text)

    def focus(self) -> Finding:
        """Whether marks are as wide as the described ones in a sharp picture."""
        wide, sharp = mark_px(self.rest, self.gel), self._sharp_px
        text = f'marks are {wide:.1f} px wide (standard deviation), {sharp:.1f} where they are sharp'
        if wide < NARROW * sharp:
            return Finding('focus', LOOK, f'{text}, smaller than described: {CHECK}')
        if wide > BLURRED * sharp:
            return Finding('focus', LOOK, f'{text}; turn the lens until they are narrowest, or {CHECK}')
        return Finding('focus', OK, text)

    def beyond(self) -> str:
        """A message if the pattern extends beyond the described gel; empty if not, or if nothing is visible there."""
        share = float(self.beside.mean())
        if share < LEAST_BESIDE or not self.gel.any():
            return ''
        if self.peaks[self.beside].mean() < AS_MANY * self.peaks[self.gel].mean():
            return ''
        return f'{percent(share)} of the image show the pattern outside the described gel: {CHECK}'

    @property
    def much_beyond(self) -> bool:
        """Whether most of the picture shows pattern outside the described gel."""
        return bool(self.beyond()) and bool(self.beside.mean() > MUCH)

    @property
    def _skewness(self) -> float:
        light = marks(self.rest)[self.gel].astype(float)
        return float((light**3).mean() / max(float(np.square(light).mean()), 1e-9) ** 1.5)

    @property
    def _expected(self) -> float:
        """Expected peaks per pixel. Close markers merge into one peak."""
        gel, pattern = self.view.sensor.gel, self.view.sensor.pattern
        markers = pattern.count / (gel.width_mm * gel.height_mm) / self.view.px_per_mm**2
        return markers / (1 + markers / MOST_PEAKS)

    @property
    def _sharp_px(self) -> float:
        """Width of described markers with a good lens. The variance of a disc is a quarter of its squared radius."""
        return math.sqrt(self.view.marker_radius_px**2 / 4 + 1 / 12 + LENS_PX**2)


def markers_of(peaks: float) -> float:
    """Markers per pixel from peaks per pixel: close markers merge into one peak, so 0.015 peaks are 0.03 markers."""
    return peaks / (1 - min(peaks / MOST_PEAKS, MOST_MERGED))


def beside(within: Bool[np.ndarray, 'h w']) -> Bool[np.ndarray, 'h w']:
    """The area that is surely outside a part of a picture."""
    reach = 2 * math.ceil(BESIDE * within.shape[1]) + 1
    return np.asarray(cv2.dilate(within.astype(np.uint8), np.ones((reach, reach), np.uint8)) == 0)
