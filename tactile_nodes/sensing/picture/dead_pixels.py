"""Dead pixels, which always show one grey: they are found at rest and filled in from the pixels around them.

A picture of markers through a lens is smooth. The covariance of the rest image predicts a pixel from the 24 around it
to within a few grey levels (kriging). The motion measured in such a filled picture is as without dead pixels.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from tactile_nodes.shapes import Bool, Float, Float32, UInt8

REACH_PX = 2
"""Reach to either side of the pixels that are used to fill one in."""

LEAST_OFF_GREY, OFF_SIGMAS = 16.0, 8.0
"""A pixel is off if it differs from the rest image by so many grey levels, and so many times the usual difference."""

MIDDLING, MOST_MIDDLING, SOME = 0.6, 0.5, 1e-4
"""Pixels beyond this share of the limit but not off must be fewer than half of the off pixels plus a ten thousandth of
all. Dead pixels are either clearly off or not at all; blur and JPEG leave more in between."""

END_GREY, END_SHARE = 6, 0.3
"""Pixels at 0 or 255 are off if the rest image differs by so much, and if this share of them is off anyway."""

SEEN = 3
"""A pixel is dead after so many frames that were still except for such pixels, even with touches between them."""

MOST_SHARE = 0.1
"""Largest share of dead pixels in a picture."""

LEAST_AROUND = 0.5
"""Least share of good pixels around a dead one. This excludes specks of dirt."""

ALIVE_GREY = 8.0
"""A dead pixel whose grey changed by more than this since it was found is alive again."""

CHECK_EVERY, IN_VAIN, SELDOM = 32, 8, 16
"""Frames between checks for living pixels; vain searches after which only one in so many frames is searched."""

AT_CAPTURE_GREY = 6.0, 120.0
"""In a captured rest image, pixels at 0 and at 255 are dead if their prediction differs by so much. No marker stands
out by 120 grey levels, as its light also falls on the pixels beside it."""

MOST_ENDS = 0.25
"""Largest share of 0 or 255 in the pixels around. More means a black background or too much light."""

NEARLY_ALL = 0.9
"""If so many of the pixels at 0, or at 255, are dead, all of them count as dead."""

NUGGET = 2e-3
"""Pixel noise as a share of the variance."""

_BESIDE = np.array(
    [(y, x) for y in range(-REACH_PX, REACH_PX + 1) for x in range(-REACH_PX, REACH_PX + 1) if (y, x) != (0, 0)]
)


class Filling:
    """Fills in dead pixels of pictures with the same pixel covariance as the picture `like`."""

    def __init__(self, like: UInt8[np.ndarray, 'h w'], dead: Bool[np.ndarray, 'h w']) -> None:
        self._mean = float(like.mean())
        rows, cols = np.nonzero(dead)
        at_row, at_col = rows[:, None] + _BESIDE[:, 0], cols[:, None] + _BESIDE[:, 1]
        height, width = dead.shape
        inside = (at_row >= 0) & (at_row < height) & (at_col >= 0) & (at_col < width)
        around = np.clip(at_row, 0, height - 1) * width + np.clip(at_col, 0, width - 1)
        good = inside & ~dead.reshape(-1)[around]
        self.pixels = rows * width + cols
        self._around, self._weights = around, _weights(covariance(like), good).astype(np.float32)

    def __call__(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The picture with the dead pixels filled in."""
        filled: np.ndarray = image.copy()
        mean = np.float32(self._mean)
        predicted = np.einsum('pn,pn->p', image.reshape(-1)[self._around] - mean, self._weights) + mean
        filled.reshape(-1)[self.pixels] = np.clip(np.rint(predicted), 0, 255).astype(np.uint8)
        return filled

    def without(self, alive: Bool[np.ndarray, ' pixels']) -> None:
        """Stop filling in the pixels that are `alive`."""
        dead = ~alive
        self.pixels = self.pixels[dead]
        self._around, self._weights = self._around[dead], self._weights[dead]


class DeadPixels:
    """Finds dead pixels relative to one rest image, and fills them in. `looks` frames must agree on them.

    After vain searches only one in `seldom` frames is searched.
    """

    def __init__(self, looks: int = SEEN, seldom: int = SELDOM) -> None:
        self._needed, self._seldom = looks, seldom
        self._rest: np.ndarray | None = None
        self._filling: Filling | None = None
        self._greys = np.zeros(0, np.uint8)
        self._suspects: np.ndarray | None = None
        self._seen = self._looks = self._frames = 0

    @property
    def count(self) -> int:
        """Number of pixels that are filled in."""
        return 0 if self._filling is None else len(self._filling.pixels)

    def captured(self, rest: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """Take a rest image captured from raw frames. Returns it with its dead pixels filled in.

        These are pixels at 0 or 255 that differ clearly from the prediction of their neighbours.
        """
        self._filling = None
        return self.renewed(rest)

    def renewed(self, rest: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """As `captured`, for a rest image made of mended frames. Known dead pixels stay dead."""
        dead = _impossible(rest)
        if dead.any():
            roughly = np.where(dead, cv2.medianBlur(rest, 2 * REACH_PX + 1), rest)
            self._take(Filling(roughly, dead)(rest), rest, dead)
        mended = rest if self._filling is None else self._filling(rest)
        self.beside(mended)
        return mended

    def beside(self, rest: UInt8[np.ndarray, 'h w']) -> None:
        """Compare mended frames with this rest image from now on."""
        self._rest = rest
        self._forget()

    def mended(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image with dead pixels filled in, or the image itself if there are none or its size differs."""
        if self._filling is None or (self._rest is not None and image.shape != self._rest.shape):
            return image
        self._frames += 1
        if self._frames % CHECK_EVERY == 0:
            self._let_live(image)
        return self._filling(image) if self.count else image

    def look(self, image: UInt8[np.ndarray, 'h w'], still: Callable[[np.ndarray], bool]) -> bool:
        """Search a mended frame that shows more than motion. Returns whether new dead pixels were found.

        `still` says whether a picture shows the same as the rest image, without a touch. Pixels are dead only if some
        frames are still except for the pixels that are off.
        """
        self._looks += 1
        if self._rest is None or (self._looks > IN_VAIN and self._looks % self._seldom):
            return False
        off = _off(image, self._rest)
        if not 0 < np.count_nonzero(off) <= MOST_SHARE * off.size or around(off)[off].min() < LEAST_AROUND:
            return False
        if not still(Filling(self._rest, off)(image)):
            return False  # something touches
        self._suspects = off if self._suspects is None else self._suspects & off
        self._seen, self._looks = self._seen + 1, 0
        if self._seen < self._needed:
            return False
        found = bool(self._suspects.any())
        if found:
            self._take(self._rest, image, self._suspects)
        self._forget()
        return found

    def _forget(self) -> None:
        self._suspects, self._seen, self._looks = None, 0, 0

    def _take(self, like: np.ndarray, image: np.ndarray, more: np.ndarray) -> None:
        """Fill in these pixels as well from now on."""
        dead, greys = more.copy(), image.copy()
        if self._filling is not None:
            dead.reshape(-1)[self._filling.pixels] = True
            greys.reshape(-1)[self._filling.pixels] = self._greys
        self._filling = Filling(like, dead)
        self._greys = greys.reshape(-1)[self._filling.pixels]

    def _let_live(self, image: np.ndarray) -> None:
        assert self._filling is not None
        shown = image.reshape(-1)[self._filling.pixels].astype(np.float32)
        alive = np.abs(shown - self._greys) > ALIVE_GREY
        if alive.any():
            self._filling.without(alive)
            self._greys = self._greys[~alive]


def around(dead: Bool[np.ndarray, 'h w']) -> Float32[np.ndarray, 'h w']:
    """Share of good pixels around each pixel."""
    side = 2 * REACH_PX + 1
    sums = cv2.boxFilter((~dead).astype(np.float32), -1, (side, side), normalize=False, borderType=cv2.BORDER_REFLECT)
    share: np.ndarray = (sums - ~dead) / np.float32(side * side - 1)
    return share


def covariance(picture: UInt8[np.ndarray, 'h w']) -> Float[np.ndarray, 'side side']:
    """Covariance of a pixel with those up to twice `REACH_PX` rows and columns away. Its variance is in the middle."""
    reach = 2 * REACH_PX
    about: np.ndarray = picture.astype(np.float32) - np.float32(picture.mean())
    height, width = about.shape
    found = np.empty((2 * reach + 1, 2 * reach + 1))
    for down in range(reach + 1):
        for right in range(-reach, reach + 1):
            one = about[: height - down, max(0, -right) : width - max(0, right)]
            other = about[down:, max(0, right) : width - max(0, -right)]
            found[reach + down, reach + right] = found[reach - down, reach - right] = float((one * other).mean())
    found[reach, reach] *= 1 + NUGGET
    return found


def _weights(covariance: Float[np.ndarray, 'side side'], good: Bool[np.ndarray, 'pixels 24']) -> np.ndarray:
    """Weight of each good pixel around, for the best linear prediction."""
    middle = 2 * REACH_PX
    apart = middle + _BESIDE[:, None] - _BESIDE[None]
    among, with_it = covariance[apart[:, :, 0], apart[:, :, 1]], covariance[tuple((middle + _BESIDE).T)]
    scale = max(float(covariance[middle, middle]), 1e-6)
    normal = among / scale * (good[:, :, None] & good[:, None, :])
    which = np.arange(len(_BESIDE))
    normal[:, which, which] = 1.0
    weights: np.ndarray = np.linalg.solve(normal, (with_it / scale * good)[:, :, None])[:, :, 0]
    return weights


def _off(image: UInt8[np.ndarray, 'h w'], rest: UInt8[np.ndarray, 'h w']) -> Bool[np.ndarray, 'h w']:
    """Pixels that differ from the rest image far more than the others. None if too many pixels differ by less."""
    apart = cv2.absdiff(image, rest)
    limit = max(LEAST_OFF_GREY, OFF_SIGMAS * 1.5 * float(np.median(apart[::4, ::4])))
    off: np.ndarray = apart > limit
    for end in (0, 255):
        at_end = (image == end) & (apart >= END_GREY)
        if np.count_nonzero(off & at_end) > END_SHARE * np.count_nonzero(at_end):
            off |= at_end
    middling = np.count_nonzero((apart > MIDDLING * limit) & ~off)
    if middling > MOST_MIDDLING * np.count_nonzero(off) + SOME * off.size:
        off[:] = False
    return off


def _impossible(rest: UInt8[np.ndarray, 'h w']) -> Bool[np.ndarray, 'h w']:
    """Pixels at 0 or 255 that are far from their prediction and have few other such pixels around them."""
    ends = (rest == 0) | (rest == 255)
    found = np.zeros(rest.shape, bool)
    if not ends.any() or ends.mean() > MOST_SHARE:
        return found
    like = np.where(ends, cv2.medianBlur(rest, 2 * REACH_PX + 1), rest)
    predicted = Filling(like, ends)(rest)[ends].astype(np.float32)
    dark, bright = AT_CAPTURE_GREY
    black, sure = rest[ends] == 0, around(ends)[ends] >= 1 - MOST_ENDS
    far = sure & np.where(black, predicted > dark, predicted < 255 - bright)
    for end in (black, ~black):
        if far[end].sum() > NEARLY_ALL * end.sum():
            far |= end & sure
    found[ends] = far
    return found
