"""When not to trust the number: no picture, no rest image worth the name, no contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from tactile_nodes.errors import ImageError

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


def picture_faults(image: UInt8[np.ndarray, 'h w']) -> PictureFaults:
    """Judge an image by every fourth pixel of every fourth row."""
    sample = np.ascontiguousarray(image[::4, ::4])  # in one piece it is counted three times as fast
    # A percentile by counting: sorting would cost ten times as much, for each frame.
    bright = np.count_nonzero(sample >= DARK_GREY) > 0.01 * sample.size
    saturated = np.count_nonzero(sample == 255) > SATURATED_SHARE * sample.size
    return PictureFaults(float(sample.mean()), not bright, bool(saturated))


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
            f'the rest image shows markers in {share:.0%} of its regions, too few to measure by; '
            'check focus, light and that the camera looks at the gel, then capture it again'
        )


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
