"""Decides whether anything touches, from the patches' motion relative to the whole picture: loosely and strictly."""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.picture.touch_places import TouchPlaces
from tactile_nodes.shapes import Bool, Float

PATCHES = 10
LOOSE_PX, LOOSE_SHARE, LOOSE_MEDIANS = 0.025, 0.05, 1.5
"""By the coarse check a picture is at rest if 19 of 20 patches follow its motion to within this.

A share of the knock's size and a multiple of the median distance are added: blur and light move patches all over the
picture, a touch only those around it.
"""

EXPLAINED, UNEXPLAINED_PX = 0.9, 0.25
"""If the median patch is explained by less than this share of its former value, part of the pattern is gone, which no
press causes (presses to 2 mm leave 0.97). Patches then seem to move in random directions by a share of the loss."""

QUIET_PX = 0.03
"""If more than 1 of 20 patches are further than this from the common motion, something touches."""

QUIET_NOISE = 7.5
"""Largest motion away from any place without a touch, in units of the median patch's noise.

Noise, which is larger at the rim, reaches 7 in eleven of twelve frames; 20 mN cause 10.8 to 19.
"""
TOUCHED_NOISE = 10.0
"""The same limit above which 20 mN may touch. Noise reaches it in less than one frame of a hundred."""

KNOCKED_NOISE = 12.0
"""The same limit for frames after a knock, from which the patch offsets of the shifted pixel grid are learnt. At rest
the motion reaches 8. A touch of 50 mN or more, which would be learnt as an offset and then hidden, causes 18 to 62. A
gel reseated by 0.1 mm, whose near and far markers move differently, leaves each patch off by some 0.014 px and reaches
5 to 9 of that, so the size of the noise must not count here."""

MEDIAN_OF_NOISE, LEAST_NOISE_PX = 0.6745, 0.0015

OUTLIERS = 0.05
"""Share of the patches that may move further at rest."""

PLACES = TouchPlaces(PATCHES, np.ones((PATCHES * PATCHES, 2)))


def loosely_quiet(
    left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], moved_px: float, explained: float
) -> bool:
    """Whether at most a light touch moves the patches, for a picture that may differ from the rest image.

    Args:
        left: motion of each patch relative to the whole picture, px.
        found: which patches were found.
        moved_px: motion of the whole picture.
        explained: how well the median patch is explained, relative to the rest image itself.
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
    """Whether the patches' residual motion is noise: not more of it points away from any place than noise causes."""
    few = _share_beyond(_squared(left[found]), QUIET_PX) <= OUTLIERS
    return few and none_away(left, found, limit, compiled=compiled)


def none_away(
    left: Float[np.ndarray, 'patches 2'], found: Bool[np.ndarray, ' patches'], limit: float, *, compiled: bool = False
) -> bool:
    """Whether the motion away from any place is at most `limit` times the noise, however large the noise is."""
    most = PLACES.most(np.where(found[:, None], left, 0.0).astype(np.float32), compiled=compiled)
    return most <= limit * noise_of(left[found])


def noise_of(left: Float[np.ndarray, 'n 2'], least_px: float = LEAST_NOISE_PX) -> float:
    """Standard deviation of a patch's motion along an axis, from the median, px."""
    return max(median(np.abs(left).reshape(-1)) / MEDIAN_OF_NOISE, least_px)


def median(values: Float[np.ndarray, ' n']) -> float:
    """As `numpy.median` for finite numbers, in a sixth of the time."""
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
