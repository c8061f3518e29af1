"""When not to trust the number: no picture, no rest image worth the name, no contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.compiling import compiled_loops

DARK_GREY = 8
"""An image whose 99th percentile stays below this shows nothing: markers under light reach 60 and more."""

SATURATED_SHARE = 0.25
"""A picture with a larger share of pixels at 255 has lost its markers in the light."""


@dataclass(frozen=True)
class PictureFaults:
    """What is wrong with an image as a picture: its mean grey level, and whether it is black or burnt out."""

    level: float
    dark: bool
    saturated: bool


def picture_faults(image: UInt8[np.ndarray, 'h w'], *, compiled: bool = False) -> PictureFaults:
    """Judge an image by every fourth pixel of every fourth row; one without pixels is dark."""
    if not image.size:
        return PictureFaults(0.0, True, False)
    if compiled and image.flags.c_contiguous:
        total, bright, burnt = compiled_loops().counted(image, 4, DARK_GREY)
        size = -(-image.shape[0] // 4) * -(-image.shape[1] // 4)
        return PictureFaults(total / size, bright <= 0.01 * size, burnt > SATURATED_SHARE * size)
    sample = np.ascontiguousarray(image[::4, ::4])  # in one piece it is counted three times as fast
    # A percentile by counting: sorting would cost ten times as much, for each frame.
    bright = np.count_nonzero(sample >= DARK_GREY) > 0.01 * sample.size
    saturated = np.count_nonzero(sample == 255) > SATURATED_SHARE * sample.size
    return PictureFaults(cv2.sumElems(sample)[0] / sample.size, not bright, bool(saturated))


def require_picture(image: UInt8[np.ndarray, 'h w']) -> None:
    """Refuse an image without a picture in it.

    Raises:
        ImageError: it is black or overexposed.
    """
    faults = picture_faults(image)
    if faults.dark:
        raise ImageError('the camera image is black; switch on the light in the sensor or uncover the lens')
    if faults.saturated:
        raise ImageError('the camera image is overexposed; lower the exposure, the gain or the light')


MARKED_SHARE = 0.1
"""Share of the regions that must hold markers before a rest image is taken."""


def require_rest_image(
    image: UInt8[np.ndarray, 'h w'], confidence: Float32[np.ndarray, 'rows cols'], marked_share: float = MARKED_SHARE
) -> None:
    """Refuse an image that displacement cannot be measured against.

    `confidence` is the texture of its regions, as `texture_confidence` measures it.

    Raises:
        ImageError: it is black, overexposed or shows too few markers.
    """
    require_picture(image)
    if (share := float((confidence >= 0.5).mean())) < marked_share:
        raise ImageError(
            f'the rest image shows markers in only {share:.0%} of its regions, too few to measure motion; '
            'check focus and light and that the camera sees the gel, then capture it again'
        )


SHARPNESS_ROWS = 4
"""Every so many rows are looked at: 0.05 ms for 440x440 pixels."""


FAR_LIGHT = (0.4, 1.4)
"""Beyond these no rest image helps enough: too dark, too bright."""

FAINT_LIGHT = 0.15
"""In less of the light forces are no forces any more (docs/results/drift.md, the light fades)."""

SHARPNESS_OFF = (-0.018, 0.05)
"""A blur of 0.4 px takes so much of it, noise of three times as much adds the other; no rest image helps either."""

BLURRED_OFF, RENEWED_OFF = -0.007, -0.014
"""Beside the sharpness of single frames of a capture, where that is known: a blur of a quarter of a pixel takes the
first, light of 1.3 times as much 0.006 and a press 0.0015. Renewed rest images are of fewer frames, and of another
light, so that what noise adds to a frame is known less well; a blur of 0.35 px takes the second."""

REST_BLURRED_OFF = -0.005
"""A rest image that has so much less sharpness than another is blurred; its noise makes 0.002 of it."""

NEAR_LIGHT = {'dis': (0.98, 1.02)}
"""Dense inverse search takes light for motion: 30 % darker it reads 0.6 of it. Presses change it by 0.6 % at most, a
camera shifted by 5 px by 0.8 %."""

NEAR_LIGHT_OF_PATCHES = (0.8, 1.2)
"""Patches know light apart, but not that markers are brighter than the camera can tell."""


class Unlike(NamedTuple):
    """In what a picture is unlike another."""

    light: bool
    blurred: bool
    noisy: bool

    def __or__(self, other: Unlike) -> Unlike:
        return Unlike(*(a or b for a, b in zip(self, other, strict=True)))

    def __bool__(self) -> bool:
        return any(self)


@dataclass(frozen=True)
class PictureLikeness:
    """Tells by little of each picture whether its light and its sharpness are those of a rest image.

    `near_light` is the least and the most light, as a share, in which motion is measured as well; `least_off` how much
    less sharpness.
    """

    level: float
    sharpness: float
    near_light: tuple[float, float]
    least_off: float

    @classmethod
    def of(
        cls, rest_image: UInt8[np.ndarray, 'h w'], flow: str, added: float | None = None, *, renewed: bool = False
    ) -> PictureLikeness:
        """To a rest image.

        Args:
            rest_image: what pictures are compared with.
            flow: the name of what measures motion.
            added: how much sharper frames are by their noise than the mean of a capture, where that is known.
            renewed: it was taken by itself.
        """
        least_off = SHARPNESS_OFF[0] if added is None else added + (RENEWED_OFF if renewed else BLURRED_OFF)
        level = max(picture_faults(rest_image).level, 1.0)
        return cls(level, sharpness(rest_image), NEAR_LIGHT.get(flow, NEAR_LIGHT_OF_PATCHES), least_off)

    def near(self, level: float, sharp: float) -> Unlike:
        """In what a picture of this mean grey and `sharpness` is so unlike that motion is measured less well."""
        return self._beyond(level, sharp, self.near_light)

    def far(self, level: float, sharp: float) -> Unlike:
        """In what it is so unlike that no other rest image helps."""
        return self._beyond(level, sharp, FAR_LIGHT)

    def faint(self, level: float) -> bool:
        """Whether a picture of this mean grey is so dark that nothing can be measured in it."""
        return level < FAINT_LIGHT * self.level

    def as_sharp(self, sharp: float, of: float) -> bool:
        """Whether a picture is surely as sharp as those of this rest image, and the rest image in use, `of`, is not."""
        return of < self.sharpness + REST_BLURRED_OFF and sharp - self.sharpness >= self.least_off - BLURRED_OFF / 2

    def _beyond(self, level: float, sharp: float, light: tuple[float, float]) -> Unlike:
        off = sharp - self.sharpness
        bright = not light[0] <= level / self.level <= light[1]
        return Unlike(bright, not off >= self.least_off, off > SHARPNESS_OFF[1])


def sharpness(image: UInt8[np.ndarray, 'h w'], *, compiled: bool = False) -> float:
    """Mean difference of pixels side by side over that of pixels three apart.

    Light cancels out and a press changes nothing (0.534 to 0.536 on the simulated gel, rest image 0.525); a blur of
    1 px more leaves 0.44, noise of four times as much 0.59, and of nothing but noise it is 1.
    """
    if compiled and image.flags.c_contiguous:
        near, far = compiled_loops().differences(image, SHARPNESS_ROWS // 2, SHARPNESS_ROWS)
        return near / far if far > 0 else 0.0
    rows = np.ascontiguousarray(image[SHARPNESS_ROWS // 2 :: SHARPNESS_ROWS])
    near, far = (float(cv2.mean(cv2.absdiff(rows[:, by:], rows[:, :-by]))[0]) for by in (1, 3))
    return near / far if far > 0 else 0.0


@dataclass
class ContactDetector:
    """Contact yes or no from the total force, with a lower threshold for letting go, so that noise does not chatter.

    With 0.05 N and a share of 0.6 contact begins at 0.05 N and ends below 0.03 N.
    """

    threshold_n: float = 0.05
    release_share: float = 0.6
    in_contact: bool = False

    def update(self, total_n: float) -> bool:
        """Whether something touches, after one more force sample."""
        limit = self.threshold_n * (self.release_share if self.in_contact else 1.0)
        self.in_contact = total_n >= limit
        return self.in_contact
