"""Does anything touch? By the motion of patches all over a picture, beside that of the whole of it: loosely, surely."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from tactile_nodes.sensing.picture.touch_places import TouchPlaces

PATCHES = 10
LOOSE_PX, LOOSE_SHARE, LOOSE_MEDIANS = 0.025, 0.05, 1.5
"""A picture is at rest, as far as a coarse look tells, when 19 of 20 patches follow it to within this.

To it are added a share of the knock's size and of the middle patch's distance: blur and light move patches all over the
picture, a touch those around it.
"""

EXPLAINED, UNEXPLAINED_PX = 0.9, 0.25
"""Of a picture of which the middle patch is explained by less than this share of what it was, something is gone that no
press takes away (presses to 2 mm leave 0.97): patches then seem to move by a share of what is missing, each its way."""

QUIET_PX = 0.03
"""More than 1 of 20 patches further than this from the common motion were touched, without a closer look."""

QUIET_NOISE = 7.5
"""Motion away from any place, in units of the middle patch's noise, up to which nothing touches.

Noise, which is larger at the rim, reaches 7 in eleven of twelve frames; 20 mN make 10.8 to 19.
"""
TOUCHED_NOISE = 10.0
"""The same from which something of 20 mN may touch: noise reaches it in less than one frame of a hundred."""

KNOCKED_NOISE = 12.0
"""The same of frames after a knock, from which is learned what patches are off by as pixels fell elsewhere. At rest it
reaches 8; a touch of 50 mN or more, which would be learned with it and read as none from then on, makes 18 to 62. A gel
seated anew by 0.1 mm, whose near markers move otherwise than far ones, leaves every patch off by some 0.014 px and is
at 5 to 9 of that, so how large noise is must not count here."""

MEDIAN_OF_NOISE, LEAST_NOISE_PX = 0.6745, 0.0015

OUTLIERS = 0.05
"""Share of the patches that may go further at rest."""

PLACES = TouchPlaces(PATCHES, np.ones((PATCHES * PATCHES, 2)))


def loosely_quiet(
    left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], moved_px: float, explained: float
) -> bool:
    """Whether no more than a light touch moves patches, as far as a picture tells that is not that of the rest image.

    Args:
        left: motion of each patch beside the picture's, px.
        found: which patches were found.
        moved_px: how far the whole picture moved.
        explained: how well the middle patch is explained, beside the rest image itself.
    """
    squared = _squared(left[found])
    limit = LOOSE_PX + LOOSE_SHARE * moved_px + LOOSE_MEDIANS * math.sqrt(median(squared))
    if explained < EXPLAINED:
        limit += UNEXPLAINED_PX * (1 - explained)
    return _share_beyond(squared, limit) <= OUTLIERS


def quiet(
    left: Float[np.ndarray, 'patches 2'],
    found: Bool[np.ndarray, ' patches'],
    limit: float = QUIET_NOISE,
    *,
    compiled: bool = False,
) -> bool:
    """Whether what is left of the patches' motion is noise: no more points away from anywhere than noise makes."""
    few = _share_beyond(_squared(left[found]), QUIET_PX) <= OUTLIERS
    return few and none_away(left, found, limit, compiled=compiled)


def none_away(
    left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], limit: float, *, compiled: bool = False
) -> bool:
    """Whether no more goes away from any place than `limit` times the noise, however large that is."""
    most = PLACES.most(np.where(found[:, None], left, 0.0).astype(np.float32), compiled=compiled)
    return most <= limit * noise_of(left[found])


def noise_of(left: Float[np.ndarray, 'n 2'], least_px: float = LEAST_NOISE_PX) -> float:
    """Standard deviation of a patch's motion along an axis, by the middle one, px."""
    return max(median(np.abs(left).reshape(-1)) / MEDIAN_OF_NOISE, least_px)


def median(values: Float[np.ndarray, ' n']) -> float:
    """As numpy's, of some finite numbers, in a sixth of the time."""
    half, ordered = len(values) // 2, values.copy()
    ordered.partition(half)
    above = float(ordered[half])
    return above if len(values) % 2 else (above + float(ordered[:half].max())) / 2


def _squared(left: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, ' n']:
    x, y = left.T
    squared: np.ndarray = x * x + y * y
    return squared


def _share_beyond(squared: Float[np.ndarray, ' n'], limit_px: float) -> float:
    return int(np.count_nonzero(squared > limit_px**2)) / len(squared)
