"""A small convolutional network that redistributes the forces of a solved field over the patches.

The solver smears forces: the regularization spreads them, the layer is not linear under large strain, and the flow
averages over regions. The network has seen how, in simulated touches of random bodies (`learning.field.refining`). It
keeps the net shear and the torsion, which the solver finds well. It also keeps the total normal force and its centre,
except for markers near the surface: there the solver tells too little force. Its layers are 3x3 convolutions with ReLU
between them; the last one gives the change of normal force and shear on each patch. Outside the box around the solved
patches everything is zero, so that the cost depends on the size of the contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.lib.stride_tricks import as_strided

from tactile_nodes.sensing.explain.field.solver import LEAST_N, Field
from tactile_nodes.shapes import Bool, Float, Float32

INPUTS = 10
"""Normal force, shear along x and y, residual motion x and y, motion x and y, whether the patch was solved, and two
that are the same everywhere: the size of the motion, and its ratio to the noise."""

VECTORS = (1, 2), (3, 4), (5, 6)
"""Inputs that are the components of vectors."""

SOLVED = 7
"""The input that is 1 on solved patches."""

MARGIN, GROWN = 2, 1
"""Patches beyond the solved ones that the network sees, and those on which it can put force."""

LEAST_SPREAD = 0.05
"""Least mean squared distance of a contact's force from its centre [patches²], added before it is tilted: a single line
can hardly be tilted or turned."""

_GROWN = np.ones((2 * GROWN + 1, 2 * GROWN + 1), np.uint8)

KEPT = 1.0, 1.0
"""Limits of the total that leave it as solved."""

CHANGE = 0.5
"""Share of the total force that an output of 1 stands for."""

FORCE_TIMES, LEFT_TIMES, LOG_MOTION, LOG_RATIO = 4.0, 2.0, 2.0, 1.0
"""Factors and offsets that bring the inputs to similar sizes."""


def inputs_of(
    found: Field, maps: Float32[np.ndarray, 'rows cols 4'], noise_px: float, shape: tuple[int, int]
) -> Float32[np.ndarray, 'inputs h w']:
    """The network's inputs on patches of this `shape`.

    `maps` are the motion of all regions that the field leaves, and their motion, along x and y; 0 if unknown.
    """
    moved = maps[..., 2:].ravel()
    size_px = max(math.sqrt(float(moved @ moved) / (int(np.count_nonzero(moved)) or 1)), 1e-6)
    inputs = np.zeros((INPUTS, *shape), np.float32)
    inputs[:3] = found.forces_n.reshape(3, *shape)
    inputs[:3] *= FORCE_TIMES / max(found.total_n, LEAST_N)
    inputs[3:SOLVED] = cv2.resize(maps, shape[::-1], interpolation=cv2.INTER_LINEAR).transpose(2, 0, 1)
    inputs[3:5] *= LEFT_TIMES / size_px
    inputs[5:SOLVED] *= 1 / size_px
    inputs[SOLVED].reshape(-1)[found.active] = 1
    inputs[SOLVED + 1] = math.log(size_px) + LOG_MOTION
    inputs[SOLVED + 2] = math.log(size_px / noise_px) / 2 - LOG_RATIO
    return inputs


@dataclass(frozen=True)
class Refinement:
    """The network: kernels of its layers, from the inputs to the changes of the three forces, and their biases.

    `limits` are those of the total normal force, as multiples of the solved one. If both are 1, its centre stays, too.
    """

    kernels: tuple[Float32[np.ndarray, '_out _in 3 3'], ...]
    biases: tuple[Float32[np.ndarray, ' _out'], ...]
    limits: tuple[float, float] = KEPT

    @property
    def keeps_total(self) -> bool:
        """Whether the total normal force and its centre stay as solved."""
        return self.limits == KEPT

    @property
    def parameter_count(self) -> int:
        return sum(each.size for each in (*self.kernels, *self.biases))

    def refined(self, found: Field, inputs: Float32[np.ndarray, 'inputs h w']) -> Field:
        """The field with its forces redistributed; `inputs` are as from `inputs_of`.

        Contacts wider than the bodies that were learnt from stay as they are: more of the force of a flat square of
        20 mm would be misplaced, 14 to 20 % instead of 6 % (`tactile bench contacts`).
        """
        if found.total_n < LEAST_N:
            return found
        rows, cols = (_around(inputs[SOLVED].any(axis=axis)) for axis in (1, 0))
        near = np.s_[:, rows, cols]
        seen, forces = inputs[near], found.forces_n.reshape(3, *inputs.shape[1:])
        before = forces[near]
        change = CHANGE * (1 - found.wide) * found.total_n
        changed = before + change * self._changes(seen)
        changed *= cv2.dilate(seen[SOLVED], _GROWN)
        if changed[0].max() <= 0:
            return found
        refined = np.zeros_like(forces)
        moved, solved = changed.reshape(3, -1), before.reshape(3, -1)
        refined[near] = _kept(moved, solved, before.shape[2], self.limits).reshape(before.shape)
        return replace(found, forces_n=refined.reshape(3, -1))

    def _changes(self, inputs: Float32[np.ndarray, 'inputs h w']) -> Float32[np.ndarray, '3 h w']:
        values = inputs
        for number, (kernel, bias) in enumerate(zip(self.kernels, self.biases, strict=True)):
            values = _convolved(values, kernel, bias)
            if number + 1 < len(self.kernels):
                np.maximum(values, 0, out=values)
        return values


def _kept(
    changed: Float[np.ndarray, '3 n'], before: Float[np.ndarray, '3 n'], cols: int, limits: tuple[float, float]
) -> Float[np.ndarray, '3 n']:
    """Changed forces that do not pull, within the friction cone, with the net shear and torsion of those before.

    `limits` are as in `Refinement`. Shear in proportion to the normal forces is added, along and around their centre,
    as under a rigid body that moves and turns. `n` patches lie in rows of `cols`.
    """
    place = np.array(np.divmod(np.arange(changed.shape[1]), cols)[::-1], float)
    total_n, normal = float(before[0].sum()), np.maximum(changed[0], 0.0)
    if limits == KEPT:
        centre = place @ before[0] / total_n
        normal = _centred(normal, total_n, centre, place, cols)
    else:
        told_n = float(normal.sum())
        total_n *= min(max(told_n / total_n, limits[0]), limits[1])
        normal *= total_n / told_n
        centre = place @ normal / total_n
    shear = changed[1:] * np.minimum(1.0, normal / np.maximum(np.hypot(changed[1], changed[2]), 1e-12))
    across = np.stack([centre[1] - place[1], place[0] - centre[0]])
    missing, turned_n = before[1:] - shear, across * normal
    turned = float((across * missing).sum()) / max(total_n * LEAST_SPREAD, float((across * turned_n).sum()))
    shear += np.outer(missing.sum(axis=1) / total_n, normal) + turned * turned_n
    return np.concatenate([normal[None], shear])


def _centred(
    normal: Float[np.ndarray, ' n'],
    total_n: float,
    centre: Float[np.ndarray, ' 2'],
    place: Float[np.ndarray, '2 n'],
    cols: int,
) -> Float[np.ndarray, ' n']:
    """Normal forces with this total and this centre.

    They are multiplied by a plane, and then shifted by what that lacks where few patches have force.
    """
    normal *= total_n / float(normal.sum())
    middle = place @ normal / total_n
    away = place - middle[:, None]
    (xx, xy), (_, yy) = ((away * normal) @ away.T / total_n + LEAST_SPREAD * np.eye(2)).tolist()
    x, y = (centre - middle).tolist()
    determinant = xx * yy - xy * xy
    plane = np.array([yy * x - xy * y, xx * y - xy * x]) / determinant
    normal *= np.maximum(1.0 + plane @ away, 0.0)
    by = centre - place @ normal / float(normal.sum())
    moved = cv2.filter2D(normal.reshape(-1, cols), -1, _shifting(by), borderType=cv2.BORDER_CONSTANT).ravel()
    centred: np.ndarray = moved * (total_n / float(moved.sum()))
    return centred


def _shifting(by: Float[np.ndarray, ' 2']) -> Float[np.ndarray, '3 3']:
    """The kernel that moves forces by up to one patch along x and y: shared between neighbours."""
    along_x, along_y = (np.array([max(-part, 0.0), 1 - abs(part), max(part, 0.0)]) for part in np.clip(by, -1, 1))
    return np.outer(along_y, along_x)[::-1, ::-1]


def _around(lines: Bool[np.ndarray, ' n']) -> slice:
    """From the first to the last line with solved patches, and the margin."""
    there = np.flatnonzero(lines)
    return slice(max(int(there[0]) - MARGIN, 0), int(there[-1]) + MARGIN + 1)


def _convolved(
    values: Float32[np.ndarray, 'in h w'], kernel: Float32[np.ndarray, 'out in 3 3'], bias: Float32[np.ndarray, ' out']
) -> Float32[np.ndarray, 'out h w']:
    """Cross-correlation with a 3x3 kernel, with zeros around the values."""
    count, rows, cols = values.shape
    padded = np.zeros((count, rows + 2, cols + 2), np.float32)
    padded[:, 1:-1, 1:-1] = values
    each, down, right = padded.strides
    windows = as_strided(padded, (count, 3, 3, rows, cols), (each, down, right, down, right))
    flat: np.ndarray = kernel.reshape(len(kernel), -1) @ windows.reshape(-1, rows * cols)
    flat += bias[:, None]
    return flat.reshape(-1, rows, cols)
