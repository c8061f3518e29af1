"""Contacts of a force field: patches that belong together, and the forces on them."""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.reading import Contact, Region
from tactile_nodes.shapes import Bool, Float, Int

TOUCHED = 0.03
"""Least force of a patch in a contact, as a share of the highest force on a patch."""

LEAST_SHARE = 0.03
"""Least share of the total force for a separate contact."""

VALLEY = 0.3
"""Two peaks are separate contacts if the pressure between them falls below this share of the lower peak."""

HALF = 0.5
EXCEEDED = 0.9
"""Quantile of friction, weighted by force, that counts as the greatest friction in a contact."""

LEAST_FRICTION = 0.15
"""Shear over pressure below which slip cannot be detected."""


def contacts_of(numbers: Float[np.ndarray, 'contacts 16'], spread: FieldSpread) -> tuple[Contact, ...]:
    """Contacts from their `numbers_of_contacts`, the strongest first."""
    rows: list[list[float]] = sorted(numbers.tolist(), key=lambda each: -each[2])
    return tuple(_contact_of(each, spread) for each in rows)


def _contact_of(numbers: list[float], spread: FieldSpread) -> Contact:
    x, y, total, shear_x, shear_y, torsion, lever, *extent_and_slip, normal, along, turning, across = numbers
    region = Region(
        (shear_x, shear_y), spread.shear_n(along, math.hypot(shear_x, shear_y), total), torsion,
        spread.torsion_n_mm(turning, torsion, total, lever), *extent_and_slip,
    )  # fmt: skip
    return Contact(x, y, total, spread.place_mm(across), spread.normal_n(normal, total), region)


def numbers_of_contacts(field: Field, patches: PatchGrid) -> Float[np.ndarray, 'contacts 16']:
    """The numbers of each contact of a field; empty without force.

    In order: place x, y [mm], force into the gel, along x, along y [N], torsion [N mm], root mean square distance of
    the force [mm], area [mm²], length, width [mm], angle [rad], slip share, and the standard deviations of the fit for
    normal force, shear along x [N], torsion [N mm], place along x [mm].
    """
    pressed = field.forces_n[0]
    if not pressed.any():
        return np.empty((0, 16))
    labels = parts_of(pressed, patches.shape)
    parts = [labels == number for number in np.unique(labels[labels > 0])]
    parts = [each for each in parts if pressed[each].sum() >= LEAST_SHARE * pressed.sum()]
    return np.array([_numbers_of(field, patches, each) for each in parts])


def parts_of(pressed: Float[np.ndarray, ' patches'], shape: tuple[int, int]) -> Int[np.ndarray, ' patches']:
    """The number of each patch's part, from 1; 0 without contact. Patches of a part are adjacent.

    Patches are added from the highest pressure down. Two parts that meet are merged, unless they meet in a valley and
    both are large enough. Of the values 1, 0.2, 0.8 in a row the last is a separate part: 0.2 < 0.3 * 0.8.
    """
    flat, across = np.pad(pressed.reshape(shape), 1).ravel(), shape[1] + 2
    around = np.add.outer((-across, 0, across), (-1, 0, 1)).ravel()
    part, peaks, sums = np.zeros(flat.size, int), [0.0], [0.0]
    for at in np.argsort(-flat, kind='stable')[: np.count_nonzero(flat > TOUCHED * flat.max())].tolist():
        first, *others = sorted({*part[at + around].tolist()} - {0}) or [len(peaks)]
        if first == len(peaks):
            peaks.append(float(flat[at]))
            sums.append(0.0)
        for other in others:
            if flat[at] >= VALLEY * peaks[other] or sums[other] < LEAST_SHARE * pressed.sum():
                part[part == other] = first
                sums[first] += sums[other]
        part[at] = first
        sums[first] += float(flat[at])
    return np.array(part.reshape(-1, across)[1:-1, 1:-1]).ravel()


def _numbers_of(field: Field, patches: PatchGrid, part: Bool[np.ndarray, ' patches']) -> list[float]:
    pressed, shear = field.forces_n[0] * part, field.forces_n[1:] * part
    total = float(pressed.sum())
    centre = pressed @ patches.centres_mm / total
    away = patches.centres_mm - centre
    torsion = float((away[:, 0] * shear[1] - away[:, 1] * shear[0]).sum())
    fitted = field.deviations(_levers(away[field.active], part[field.active], total)).tolist()
    lever = float(np.sqrt((pressed * np.square(away).sum(axis=1)).sum() / total))
    extent, slips = _extent(pressed, away, patches), slip_share(pressed, shear, torsion, lever)
    return [*centre, total, *shear.sum(axis=1), torsion, lever, *extent, slips, *fitted]


def _levers(
    away: Float[np.ndarray, 'active 2'], inside: Bool[np.ndarray, ' active'], total: float
) -> Float[np.ndarray, 'm 4']:
    """Weights of the active patches' forces in a contact's normal force, shear along x, torsion, and place along x."""
    levers = np.zeros((3, len(away), 4))
    x, y = away.T * inside
    levers[0, :, 0] = levers[1, :, 1] = inside
    levers[1, :, 2], levers[2, :, 2], levers[0, :, 3] = -y, x, x / total
    return levers.reshape(-1, 4)


def _extent(
    pressed: Float[np.ndarray, ' patches'], away: Float[np.ndarray, 'patches 2'], patches: PatchGrid
) -> tuple[float, float, float, float]:
    """Area [mm²] at half the highest pressure, length, width [mm] and angle of its longest axis [rad].

    Length and width are those of a uniform pressure over a rectangle with the same second moments.
    """
    within = pressed >= HALF * pressed.max()
    width, height = patches.size_mm
    about = away[within] - away[within].mean(axis=0)
    count = len(about)
    (xx, xy), (_, yy) = (12 * (about.T @ about) / count).tolist()
    xx, yy = xx + width**2, yy + height**2
    mean, off = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)  # Mohr's circle
    return count * width * height, math.sqrt(mean + off), math.sqrt(mean - off), math.atan2(2 * xy, xx - yy) / 2


def slip_share(
    pressed: Float[np.ndarray, ' patches'], shear: Float[np.ndarray, '2 patches'], torsion: float, lever_mm: float
) -> float:
    """Net shear and torsion over those at full friction all over the contact: at 1 it slips as a whole.

    Both are combined with an ellipsoidal limit surface (Howe and Cutkosky 1996), the torsion by the root mean square
    distance of the force. Shear that points inwards from all sides under a press does not count as slip. For a sphere
    it is Cattaneo's share s: q = mu (p(F) - p(F - s F)), so that the sum is s mu F.
    """
    touched = pressed > TOUCHED * pressed.max()
    friction = np.hypot(*shear[:, touched]) / pressed[touched]
    order = np.argsort(friction)
    above = np.cumsum(pressed[touched][order]) >= EXCEEDED * pressed[touched].sum()
    greatest = float(friction[order][np.argmax(above)])
    if greatest < LEAST_FRICTION:
        return 0.0
    turning = torsion / lever_mm if lever_mm > 0 else 0.0
    return min(1.0, math.hypot(*shear.sum(axis=1), turning) / (greatest * float(pressed.sum())))
