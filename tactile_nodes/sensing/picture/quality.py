"""Quality checks: black or overexposed pictures, unusable rest images, changed light or sharpness, contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.shapes import Float32, UInt8

DARK_GREY = 8
"""An image with a 99th percentile below this is black. Lit markers reach 60 and more."""

SATURATED_SHARE = 0.25
"""A picture with a larger share of pixels at 255 is overexposed."""


@dataclass(frozen=True)
class PictureFaults:
    """Mean grey level of an image, and whether it is black or overexposed."""

    level: float
    dark: bool
    saturated: bool


def picture_faults(image: UInt8[np.ndarray, 'h w'], *, compiled: bool = False) -> PictureFaults:
    """Check every fourth pixel of every fourth row. An image without pixels is dark."""
    if not image.size:
        return PictureFaults(0.0, True, False)
    if compiled and image.flags.c_contiguous:
        total, bright, burnt = compiled_loops().counted(image, 4, DARK_GREY)
        size = -(-image.shape[0] // 4) * -(-image.shape[1] // 4)
        return PictureFaults(total / size, bright <= 0.01 * size, burnt > SATURATED_SHARE * size)
    sample = np.ascontiguousarray(image[::4, ::4])  # contiguous memory is counted three times as fast
    # A percentile by counting: sorting would cost ten times as much, for each frame.
    bright = np.count_nonzero(sample >= DARK_GREY) > 0.01 * sample.size
    saturated = np.count_nonzero(sample == 255) > SATURATED_SHARE * sample.size
    return PictureFaults(cv2.sumElems(sample)[0] / sample.size, not bright, bool(saturated))


def require_picture(image: UInt8[np.ndarray, 'h w']) -> None:
    """Refuse an image that shows nothing.

    Raises:
        ImageError: the image is black or overexposed.
    """
    faults = picture_faults(image)
    if faults.dark:
        raise ImageError('the camera image is black; switch on the light in the sensor or uncover the lens')
    if faults.saturated:
        raise ImageError('the camera image is overexposed; lower the exposure, the gain or the light')


MARKED_SHARE = 0.1
"""Share of the regions of a rest image that must contain markers."""


def require_rest_image(
    image: UInt8[np.ndarray, 'h w'], confidence: Float32[np.ndarray, 'rows cols'], marked_share: float = MARKED_SHARE
) -> None:
    """Refuse a rest image that displacement cannot be measured against.

    `confidence` is the texture of its regions from `texture_confidence`.

    Raises:
        ImageError: the image is black, overexposed or shows too few markers.
    """
    require_picture(image)
    if (share := float((confidence >= 0.5).mean())) < marked_share:
        raise ImageError(
            f'the rest image shows markers in only {share:.0%} of its regions, too few to measure motion; '
            'check focus and light and that the camera sees the gel, then capture it again'
        )


SHARPNESS_ROWS = 4
"""Only one in so many rows is used: 0.05 ms for 440x440 pixels."""


FAR_LIGHT = (0.4, 1.4)
"""Ratios of light, too dark and too bright, beyond which a new rest image does not help enough."""

FAINT_LIGHT = 0.15
"""Ratio of light below which forces are meaningless (docs/results/drift.md, the light fades)."""

SHARPNESS_OFF = (-0.018, 0.05)
"""Changes of sharpness that no rest image corrects: a blur of 0.4 px causes the first, three times the noise the
second."""

BLURRED_OFF, RENEWED_OFF = -0.007, -0.014
"""Changes relative to the sharpness of single frames of a capture, if that is known: a blur of a quarter of a pixel
lowers it by the first, 1.3 times the light by 0.006 and a press by 0.0015. Renewed rest images have fewer frames and
another light, so the effect of noise is less certain; the second is a blur of 0.35 px."""

NOISY_OFF = 0.04
"""The same for noise: three times the noise adds 0.03 on the simulated sensor and 0.13 with printed dots. Frames of
dots are 0.2 sharper than their mean, because most of what differs from pixel to pixel is noise."""

MUCH_BLURRED_OFF = -0.011
"""Change beyond the one that counts as blur, from which a picture counts as another one. Together they are a blur of
half a pixel: beside a rest image without it, motion is a tenth too small, and with a blur of 1 px four tenths."""

REST_BLURRED_OFF = -0.005
"""A rest image with so much less sharpness than another is blurred. Its noise causes 0.002."""

NEAR_LIGHT = {'dis': (0.98, 1.02)}
"""Dense inverse search mistakes light for motion: in a picture 30 % darker it measures 0.6 of the motion. Presses
change the light by 0.6 % at most, a camera shifted by 5 px by 0.8 %."""

NEAR_LIGHT_OF_PATCHES = (0.8, 1.2)
"""Patches separate light from motion, but fail if markers saturate the camera."""


class Unlike(NamedTuple):
    """In which respects a picture differs from another."""

    light: bool
    blurred: bool
    noisy: bool

    def __or__(self, other: Unlike) -> Unlike:
        return Unlike(*(a or b for a, b in zip(self, other, strict=True)))

    def __bool__(self) -> bool:
        return any(self)


@dataclass(frozen=True)
class PictureLikeness:
    """Compares the light and the sharpness of pictures with those of a rest image.

    `near_light` is the range of relative light in which motion is measured equally well, `least_off` and `most_off` the
    lowest and the highest change of sharpness.
    """

    level: float
    sharpness: float
    near_light: tuple[float, float]
    least_off: float
    most_off: float

    @classmethod
    def of(
        cls, rest_image: UInt8[np.ndarray, 'h w'], flow: str, added: float | None = None, *, renewed: bool = False
    ) -> PictureLikeness:
        """The comparison with a rest image.

        Args:
            rest_image: the image that pictures are compared with.
            flow: name of the flow method.
            added: how much sharper frames are than the mean of a capture because of their noise, if known.
            renewed: the rest image was renewed automatically.
        """
        least_off, most_off = SHARPNESS_OFF
        if added is not None:
            least_off, most_off = added + (RENEWED_OFF if renewed else BLURRED_OFF), max(most_off, added + NOISY_OFF)
        level = max(picture_faults(rest_image).level, 1.0)
        return cls(level, sharpness(rest_image), NEAR_LIGHT.get(flow, NEAR_LIGHT_OF_PATCHES), least_off, most_off)

    def near(self, level: float, sharp: float) -> Unlike:
        """How a picture of this mean grey and `sharpness` differs so much that motion is measured less well."""
        return self._beyond(level, sharp, self.near_light)

    def much_blurred(self, sharp: float) -> bool:
        """Whether a picture of this `sharpness` is so blurred beside the rest image that it counts as another."""
        return not sharp - self.sharpness >= self.least_off + MUCH_BLURRED_OFF

    def far(self, level: float, sharp: float) -> Unlike:
        """How a picture differs so much that no other rest image helps."""
        return self._beyond(level, sharp, FAR_LIGHT)

    def faint(self, level: float) -> bool:
        """Whether a picture of this mean grey is too dark for any measurement."""
        return level < FAINT_LIGHT * self.level

    def as_sharp(self, sharp: float, of: float) -> bool:
        """Whether a picture is surely as sharp as this rest image, while the rest image in use (`of`) is not."""
        return of < self.sharpness + REST_BLURRED_OFF and sharp - self.sharpness >= self.least_off - BLURRED_OFF / 2

    def _beyond(self, level: float, sharp: float, light: tuple[float, float]) -> Unlike:
        off = sharp - self.sharpness
        bright = not light[0] <= level / self.level <= light[1]
        return Unlike(bright, not off >= self.least_off, off > self.most_off)


def sharpness(image: UInt8[np.ndarray, 'h w'], *, compiled: bool = False) -> float:
    """Ratio of the mean difference of adjacent pixels to that of pixels three apart.

    Light cancels out, and a press changes little (0.534 to 0.536 on the simulated gel, rest image 0.525). It is 0.44
    with 1 px more blur, 0.59 with four times the noise, and 1 for noise alone.
    """
    if compiled and image.flags.c_contiguous:
        near, far = compiled_loops().differences(image, SHARPNESS_ROWS // 2, SHARPNESS_ROWS)
        return near / far if far > 0 else 0.0
    rows = np.ascontiguousarray(image[SHARPNESS_ROWS // 2 :: SHARPNESS_ROWS])
    near, far = (float(cv2.mean(cv2.absdiff(rows[:, by:], rows[:, :-by]))[0]) for by in (1, 3))
    return near / far if far > 0 else 0.0


@dataclass
class ContactDetector:
    """Detects contact from the total force, with hysteresis against noise.

    With 0.05 N and a share of 0.6 contact begins at 0.05 N and ends below 0.03 N.
    """

    threshold_n: float = 0.05
    release_share: float = 0.6
    in_contact: bool = False

    def update(self, total_n: float) -> bool:
        """Take one more force sample, and return whether something touches."""
        limit = self.threshold_n * (self.release_share if self.in_contact else 1.0)
        self.in_contact = total_n >= limit
        return self.in_contact
