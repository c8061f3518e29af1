"""Where the gel lies in the picture: how its outline in one rest image maps onto that in another.

Markers end where the gel ends. Where there are any is told by their light, blurred until single ones do not count and
levelled where there are many, so neither brightness nor the markers' places matter. What is left is the silhouette of
the gel; the affine map that brings one silhouette onto the other is found by least squares (Lucas and Kanade, 1981).
It holds if both gels are of one size and seat, such that their outlines are at the same places of the surface frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from tactile_nodes.errors import ImageError

BACKGROUND_PX, MARKER_PX = 12.0, 1.0
"""Standard deviations of the blurs whose difference shows markers, and takes slow changes of light away."""
MARKER_NOISE = 6.0
"""How far above the noise of the picture's dark parts a marker shines."""
SMOOTH_PX = 9.0
"""Of the silhouette: a gel has a marker in about every 5 x 5 pixels."""
LEVEL = 0.25
"""Share of the usual density of markers at which the silhouette is half as high as it gets."""
MOST_STEPS = 60
CONVERGED_PX = 1e-3
LEAST_AREA = 0.1
"""Of the picture, that markers must cover and leave free: without an edge in it there is no outline."""
TERMS = 6


@dataclass(frozen=True)
class OutlineMap:
    """A place p of the one picture (px from the middle, x right, y down) is at `turn` p + `shift_px` in the other.

    `covariance` is that of turn (xx, xy, yx, yy) and shift (x, y), in these units; `misfit` the root mean square of
    what is left of the difference of the silhouettes, which are 0 outside and about 1 inside.
    """

    turn: Float[np.ndarray, '2 2']
    shift_px: Float[np.ndarray, ' 2']
    covariance: Float[np.ndarray, '6 6']
    misfit: float

    @property
    def sigma_px(self) -> Float[np.ndarray, ' 2']:
        """Standard deviations of the shift."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[4:]))

    def back(self, places_px: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
        """Where places of the other picture are in the one."""
        return np.asarray((places_px - self.shift_px) @ np.linalg.inv(self.turn).T)


def silhouette(picture: UInt8[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
    """0 where there are no markers, towards 1 where there are.

    Raises:
        ImageError: the picture has no edge of the gel in it.
    """
    light = picture.astype(np.float32)
    marks = cv2.GaussianBlur(light, (0, 0), MARKER_PX) - cv2.GaussianBlur(light, (0, 0), BACKGROUND_PX)
    noise = 1.4826 * float(np.median(np.abs(np.diff(light, axis=1)))) / np.sqrt(2)
    shining = (marks > max(MARKER_NOISE * noise / 3, 1.0)).astype(np.float32)
    density = cv2.GaussianBlur(shining, (0, 0), SMOOTH_PX)
    usual = float(np.percentile(density, 75))
    covered = float((density > LEVEL * usual).mean()) if usual > 0 else 0.0
    if not LEAST_AREA < covered < 1 - LEAST_AREA:
        raise ImageError(
            f'markers cover {100 * covered:.0f} % of the rest image, so the outline of the gel is not in it; take a '
            'picture that shows all of the gel and some of what is around it'
        )
    level = (LEVEL * usual) ** 2
    return np.asarray(density**2 / (density**2 + level), np.float32)


def outline_map(one: UInt8[np.ndarray, 'h w'], other: UInt8[np.ndarray, 'h2 w2']) -> OutlineMap:
    """How the outline of the gel in one rest image maps onto that in the other.

    Raises:
        ImageError: the pictures differ in size, or have no outline in them, or these do not fit.
    """
    if one.shape != other.shape:
        raise ImageError(f'rest images of {one.shape[::-1]} and {other.shape[::-1]} pixels; take both with one crop')
    still, moved = silhouette(one), silhouette(other)
    height, width = one.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    x, y = x - (width - 1) / 2, y - (height - 1) / 2
    numbers = np.array([1.0, 0, 0, 1, 0, 0])
    for _ in range(MOST_STEPS):
        lever, left = _compared(still, moved, numbers, x, y)
        step = np.linalg.solve(lever.T @ lever + 1e-9 * np.eye(TERMS), lever.T @ left)
        numbers = numbers + step
        if np.abs(step * np.array([*(width / 2,) * 4, 1, 1])).max() < CONVERGED_PX:
            break
    else:
        raise ImageError('the outlines of the gel in the two rest images do not fit; compare the pictures')
    lever, left = _compared(still, moved, numbers, x, y)
    # Neighbouring pixels of a blurred picture say the same: what is left is alike over this many of them.
    alike = 4 * np.pi * SMOOTH_PX**2
    spread = float(np.mean(np.square(left)))
    covariance = spread * alike * np.linalg.inv(lever.T @ lever)
    return OutlineMap(numbers[:4].reshape(2, 2), numbers[4:], covariance, float(np.sqrt(spread)))


def _compared(
    still: np.ndarray, moved: np.ndarray, numbers: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[Float[np.ndarray, 'pixels 6'], Float[np.ndarray, ' pixels']]:
    """Slopes of the moved silhouette along the map's numbers, and what it lacks to the still one."""
    middle_x, middle_y = -x[0, 0], -y[0, 0]
    xx, xy, yx, yy, right, down = numbers.astype(np.float32).tolist()
    seen = cv2.remap(
        moved, xx * x + xy * y + right + middle_x, yx * x + yy * y + down + middle_y, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    # The slopes in the moved picture's axes, from those of the warped one, by the chain rule.
    by_x, by_y = cv2.Sobel(seen, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(seen, cv2.CV_32F, 0, 1, scale=1 / 8)
    inverse = np.linalg.inv(numbers[:4].reshape(2, 2))
    gx = by_x * inverse[0, 0] + by_y * inverse[1, 0]
    gy = by_x * inverse[0, 1] + by_y * inverse[1, 1]
    lever = np.stack([gx * x, gx * y, gy * x, gy * y, gx, gy], axis=-1).reshape(-1, TERMS)[::4]
    return lever.astype(float), (still - seen).reshape(-1)[::4].astype(float)
