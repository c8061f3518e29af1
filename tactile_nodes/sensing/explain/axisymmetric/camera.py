"""Motion of the camera, found together with the contacts: few mountings hold it still under a force."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.picture.motion import TERMS, MotionFit
from tactile_nodes.shapes import Float, Int

CAMERA_PX = 1.0
"""Standard deviation of each term of that motion."""


def camera_motions(shape: tuple[int, int], known: Int[np.ndarray, ' regions']) -> Float[np.ndarray, 'terms motions']:
    """Motion of the known ones of rows x cols regions with each term, along x and y in turn (see `MotionFit`)."""
    fit = MotionFit(shape, *shape)
    return np.stack([fit.carried(each)[known].reshape(-1) for each in np.eye(TERMS)])


def taken_by_camera(
    camera: Float[np.ndarray, 'terms motions'],
    motions: Float[np.ndarray, 'n motions'],
    certainty: Float[np.ndarray, ' motions'],
) -> Float[np.ndarray, 'n n']:
    """The part of the weighted products of motions that the camera explains (Schur complement of its terms)."""
    weighted = camera * certainty
    normal, along = weighted @ camera.T, weighted @ motions.T
    normal.flat[:: TERMS + 1] += 1 / CAMERA_PX**2
    taken: np.ndarray = along.T @ np.linalg.solve(normal, along)
    return taken
