"""Pixels of the camera that show one grey whatever falls in: found at rest, filled in from those around them.

A picture of markers through a lens is smooth: what a pixel shows follows from the 24 around it to within a few grey
levels, by the covariance of the rest image (kriging). Motion is measured as before in a picture that is filled in so.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

REACH_PX = 2
"""How far to either side lie the pixels that one is filled in from."""

LEAST_OFF_GREY, OFF_SIGMAS = 16.0, 8.0
"""A pixel is off where it shows so much more or less than the rest image, and so many times what is usual of others."""

MIDDLING, MOST_MIDDLING, SOME = 0.6, 0.5, 1e-4
"""Pixels that are nearly off, by more than this share of what the others are, must be fewer than half of those and a
ten thousandth of all. Dead pixels are off altogether or not at all; blur and JPEG leave more middling ones."""

END_GREY, END_SHARE = 6, 0.3
"""Pixels that show 0 or 255 are off where the rest image is so far from there, if this share of them is off anyway."""

SEEN = 3
"""A pixel is dead when so many frames were still but for it and others, touches between them or not."""

MOST_SHARE = 0.1
"""Share of the pixels above which a picture is not one with dead pixels."""

LEAST_AROUND = 0.5
"""Share of the pixels around that must be good to fill one in by: a speck of dirt is none."""

ALIVE_GREY = 8.0
"""A pixel that shows another grey, by more, than when it was found is alive again."""

CHECK_EVERY, IN_VAIN, SELDOM = 32, 8, 16
"""Frames from one look for living ones to the next; looks in vain after which one is taken in so many frames."""

AT_CAPTURE_GREY = 6.0, 120.0
"""In a rest image that is captured pixels at 0 and at 255 are dead which those around say are so much off: 120 grey
levels below 255 lies no marker, whose light falls on pixels beside it, too."""

MOST_ENDS = 0.25
"""Of the pixels around, at 0 or 255: of more it is a picture with a black ground, or too much light."""

NEARLY_ALL = 0.9
"""Where so many of the pixels at 0, or at 255, are dead, all of them are."""

NUGGET = 2e-3
"""Share of the variance that is the noise of a pixel."""

_BESIDE = np.array(
    [(y, x) for y in range(-REACH_PX, REACH_PX + 1) for x in range(-REACH_PX, REACH_PX + 1) if (y, x) != (0, 0)]
)


class Filling:
    """Fills in some pixels of pictures that are like one picture in how neighbours go together."""

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
        """The picture with those pixels filled in."""
        filled: np.ndarray = image.copy()
        mean = np.float32(self._mean)
        told = np.einsum('pn,pn->p', image.reshape(-1)[self._around] - mean, self._weights) + mean
        filled.reshape(-1)[self.pixels] = np.clip(np.rint(told), 0, 255).astype(np.uint8)
        return filled

    def without(self, alive: Bool[np.ndarray, ' pixels']) -> None:
        """Leave some as they are from now on."""
        dead = ~alive
        self.pixels = self.pixels[dead]
        self._around, self._weights = self._around[dead], self._weights[dead]


class DeadPixels:
    """Keeps which pixels are dead beside one rest image, and fills them in; `looks` tell that they are.

    After looks in vain one in `seldom` frames is looked at.
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
        """How many are filled in."""
        return 0 if self._filling is None else len(self._filling.pixels)

    def captured(self, rest: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """Take a rest image as it was captured, of frames as they came; it is returned with its dead pixels filled in.

        They are those at 0 or 255 that their neighbours say are something else altogether.
        """
        self._filling = None
        return self.renewed(rest)

    def renewed(self, rest: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The same of one that was made of mended frames; what was dead stays so."""
        dead = _impossible(rest)
        if dead.any():
            roughly = np.where(dead, cv2.medianBlur(rest, 2 * REACH_PX + 1), rest)
            self._take(Filling(roughly, dead)(rest), rest, dead)
        mended = rest if self._filling is None else self._filling(rest)
        self.beside(mended)
        return mended

    def beside(self, rest: UInt8[np.ndarray, 'h w']) -> None:
        """Take that frames, mended, are compared with this rest image from now on."""
        self._rest = rest
        self._forget()

    def mended(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image with dead pixels filled in; the image itself where there are none, or it has another size."""
        if self._filling is None or (self._rest is not None and image.shape != self._rest.shape):
            return image
        self._frames += 1
        if self._frames % CHECK_EVERY == 0:
            self._let_live(image)
        return self._filling(image) if self.count else image

    def look(self, image: UInt8[np.ndarray, 'h w'], still: Callable[[np.ndarray], bool]) -> bool:
        """Look at a mended frame that shows more than motion; whether more pixels were found dead.

        `still`: whether a picture shows what the rest image shows, and nothing touches. Only if it is that but for
        the pixels that are off, in some frames, are they dead.
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
        """Fill in these pixels, too, from now on."""
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
    """Share of the pixels around each that are good."""
    side = 2 * REACH_PX + 1
    sums = cv2.boxFilter((~dead).astype(np.float32), -1, (side, side), normalize=False, borderType=cv2.BORDER_REFLECT)
    share: np.ndarray = (sums - ~dead) / np.float32(side * side - 1)
    return share


def covariance(picture: UInt8[np.ndarray, 'h w']) -> Float[np.ndarray, 'side side']:
    """Of a pixel with those up to twice `REACH_PX` rows and columns away; that with itself is in the middle."""
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
    """What each good one of the pixels around counts for: the best linear guess."""
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
    """Pixels that show another grey than at rest, by far more than the others; none where many do so by less."""
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
    """Pixels at 0 or 255 far from what those around say, of which the ones beside are lit or not at their limit."""
    ends = (rest == 0) | (rest == 255)
    found = np.zeros(rest.shape, bool)
    if not ends.any() or ends.mean() > MOST_SHARE:
        return found
    like = np.where(ends, cv2.medianBlur(rest, 2 * REACH_PX + 1), rest)
    told = Filling(like, ends)(rest)[ends].astype(np.float32)
    dark, bright = AT_CAPTURE_GREY
    black, sure = rest[ends] == 0, around(ends)[ends] >= 1 - MOST_ENDS
    far = sure & np.where(black, told > dark, told < 255 - bright)
    for end in (black, ~black):
        if far[end].sum() > NEARLY_ALL * end.sum():
            far |= end & sure
    found[ends] = far
    return found
