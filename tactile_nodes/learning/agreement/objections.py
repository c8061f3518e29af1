"""Contradictions in a table: motion should be where was pressed, and grow with the force.

Two exchanged columns, a mirrored axis, and rows beside the wrong images all give a wrong model without any warning.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, Float32, Int

SPANNED_MM = 4.0
"""Places closer than this along x or y do not determine the axes, unless motion surely follows them."""
CLOSE_MM, WIDE = 1.0, 0.25
"""Places closer than this cannot show motion over that share of the image, unless they are in another unit."""
FOLLOWS = 0.5
"""Correlation below which motion does not follow the table; places of correct tables are above 0.9."""
FOLLOWS_FORCE = 0.3
"""The same for forces and many presses: between a few printed dots, motion also depends on the distance to the next dot
(0.48 with a thin tip and forces of 14 to 23 g). With few presses, the limit is twice the standard deviation of the
correlation with unrelated forces."""
CLEARLY, SURELY = 0.8, 0.9
"""Correlation from which motion follows something else than the table states, and from which no chance explains it."""
ASIDE_MM, ASIDE_TIMES = 4.0, 6.0
"""A press is named if its motion is farther from its place than this, in mm and in multiples of the median."""
AGREE, AGREE_ROUNDS = 0.75, 5
"""The share of the presses that predicts the others, and how often it is chosen anew."""
ALIKE = 1.2
"""Forces whose largest is at most this times the smallest count as one force, which motion cannot follow."""
SCALE = 1.5
"""Largest ratio of pixels for a mm to those of a description; correct descriptions differ by 1.2 at most."""


def strength_of(
    motion: Float32[np.ndarray, 'n rows cols 2'], confidence: Float32[np.ndarray, 'n rows cols']
) -> Float[np.ndarray, 'n rows cols']:
    """The squared motion of the regions (px²), weighted by confidence."""
    return np.asarray(np.square(motion).sum(axis=-1) * confidence)


def from_centre(strength: Float[np.ndarray, 'n rows cols']) -> Float[np.ndarray, ' n']:
    """The squared distance of motion from the image centre, as shares of its sides: a wide lens shows it smaller."""
    return np.asarray(np.square(middles(strength) - 0.5).sum(axis=1))


def middles(strength: Float[np.ndarray, 'n rows cols']) -> Float[np.ndarray, 'n 2']:
    """The centre of motion in the image, x and y as shares of its sides: 0.5, 0.5 is the image centre."""
    sharp = np.square(strength)  # so that small motion everywhere counts little
    total = np.maximum(sharp.sum(axis=(1, 2)), 1e-12)
    y, x = ((np.arange(count) + 0.5) / count for count in sharp.shape[1:])
    return np.column_stack([sharp.sum(axis=1) @ x / total, sharp.sum(axis=2) @ y / total])


def places_objection(place_mm: Float[np.ndarray, 'n 2'], seen: Float[np.ndarray, 'n 2']) -> str:
    """What is wrong with the given places, compared with those seen; empty if nothing is, or if they do not suffice."""
    own, spanned_mm = _followed(place_mm, seen), np.ptp(place_mm, axis=0)
    if min(own) >= SURELY and max(spanned_mm) < CLOSE_MM and min(np.ptp(seen, axis=0)) >= WIDE:
        return (
            f'the given places differ by {max(spanned_mm):.2g} mm at most, but the images move from one side to the '
            'other: check the unit of x and y'
        )
    if min(own) >= FOLLOWS or min(spanned_mm) < SPANNED_MM:
        return ''
    if min(abs(_correlation(place_mm[:, axis], seen[:, 1 - axis])) for axis in (0, 1)) >= CLEARLY:
        return 'the images move along y when the given x changes, and along x when y changes: x and y are swapped'
    turned = [name for name, share in zip('xy', own, strict=True) if share <= -CLEARLY]
    if turned:
        return (
            f'the images move along {" and ".join(turned)} in the opposite direction to the given places: x points '
            'right in the image and y down; change the sign'
        )
    return (
        'the images do not move at the places given in the table: rows belong to other images, or places are not '
        'measured from the middle of the gel'
    )


def description_objection(place_mm: Float[np.ndarray, 'n 2'], seen: Float[np.ndarray, 'n 2'], sensor: Sensor) -> str:
    """What is wrong with a sensor's description, compared with the motion in images from place to place."""
    if min(np.ptp(place_mm, axis=0)) < SPANNED_MM and min(_followed(place_mm, seen)) < SURELY:
        return ''
    expected = View(sensor).shares_of(place_mm)
    for axis, side_px in enumerate(sensor.image.crop_px):
        found, described = (
            float(np.polyfit(place_mm[:, axis], shares[:, axis], 1)[0]) * side_px for shares in (seen, expected)
        )
        if not described / SCALE <= found <= described * SCALE:
            return (
                f'the moving spot shifts by {found:.0f} pixels per mm along {"xy"[axis]} between presses, but the '
                f'description of the sensor gives {described:.0f}: one of them is of another camera or gel, or the '
                'places are in another unit'
            )
    return ''


def force_objection(
    force_n: Float[np.ndarray, ' n'], shown: Float[np.ndarray, ' n'], beside: Float[np.ndarray, ' n'] | None = None
) -> str:
    """What is wrong with the given forces, compared with what the images show; empty if nothing is, or all are alike.

    Args:
        force_n: the given forces.
        shown: what grows with the force: the motion in each image, or an estimate of the force.
        beside: what else `shown` depends on, which is removed before.
    """
    from scipy.stats import rankdata

    if force_n.max() <= ALIKE * force_n.min():
        return ''
    chance = 1 / math.sqrt(max(len(force_n) - 1, 1))
    limit = min(max(FOLLOWS_FORCE, 2 * chance), FOLLOWS)
    given, follows = rankdata(force_n), rankdata(shown)
    if beside is not None:
        given, follows = _without(beside, given), _without(beside, follows)
    if _correlation(given, follows) >= limit:
        return ''
    return (
        'the images do not move more when the given force is larger: rows or columns are mixed up, or the presses are '
        'too light for what the images show (between printed dots press with a larger ball)'
    )


def aside(place_mm: Float[np.ndarray, 'n 2'], seen: Float[np.ndarray, 'n 2']) -> list[int]:
    """Presses whose motion is far from where the other presses predict it.

    The other presses are the three quarters that agree best: a fit of all follows two exchanged rows among a dozen. On
    its own it would blame a press near the rim for a wide lens, so the fit of all must find a press far off, too.
    """
    from_seen = np.column_stack([seen, np.ones(len(seen))])
    off = of_all = _off(from_seen, place_mm, np.arange(len(place_mm)))
    for _ in range(AGREE_ROUNDS):
        off = _off(from_seen, place_mm, np.argsort(off, kind='stable')[: math.ceil(AGREE * len(off))])
    far = (off > max(ASIDE_MM, ASIDE_TIMES * float(np.median(off)))) & (of_all > ASIDE_MM)
    return [int(each) for each in np.flatnonzero(far)]


def _off(
    from_seen: Float[np.ndarray, 'n 3'], place_mm: Float[np.ndarray, 'n 2'], kept: Int[np.ndarray, ' most']
) -> Float[np.ndarray, ' n']:
    """How far (mm) each press is from where the kept ones predict it."""
    expected = from_seen @ np.linalg.lstsq(from_seen[kept], place_mm[kept], rcond=None)[0]
    return np.asarray(np.linalg.norm(expected - place_mm, axis=1))


def _without(one: Float[np.ndarray, ' n'], other: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
    """The part of `other` that does not follow `one` linearly."""
    from_one = np.column_stack([one, np.ones(len(one))])
    return np.asarray(other - from_one @ np.linalg.lstsq(from_one, other, rcond=None)[0])


def _followed(place_mm: Float[np.ndarray, 'n 2'], seen: Float[np.ndarray, 'n 2']) -> list[float]:
    """The correlation of given and seen places along x, and along y."""
    return [_correlation(place_mm[:, axis], seen[:, axis]) for axis in (0, 1)]


def _correlation(one: Float[np.ndarray, ' n'], other: Float[np.ndarray, ' n']) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0 else 0.0
