"""Motion of the camera, found together with the contacts: few mountings hold it still under a force."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.picture.motion import TERMS, MotionFit
from tactile_nodes.shapes import Float, Int

STILL = np.zeros((0, 0))
"""No terms: the camera does not move."""

CAMERA_PX = 1.0
"""Standard deviation of each term of that motion."""


def camera_terms(shape: tuple[int, int], known: Int[np.ndarray, ' regions']) -> Float[np.ndarray, 'terms motions']:
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


def without_camera(
    camera: Float[np.ndarray, 'terms motions'],
    motion: Float[np.ndarray, 'n regions 2'],
    certainty: Float[np.ndarray, 'n regions 2'],
) -> Float[np.ndarray, 'n regions 2']:
    """Motions without the part that the camera explains, found for each by least squares; `certainty` is their inverse
    variance. Without terms they stay as they are."""
    if not len(camera):
        return motion
    flat, sure = motion.reshape(len(motion), -1), certainty.reshape(len(motion), -1)
    products = np.einsum('am,bm->mab', camera, camera).reshape(flat.shape[1], -1)
    normal = (sure @ products).reshape(-1, TERMS, TERMS) + np.eye(TERMS) / CAMERA_PX**2
    terms = np.linalg.solve(normal, ((flat * sure) @ camera.T)[..., None])[..., 0]
    still: np.ndarray = motion - (terms @ camera).reshape(motion.shape)
    return still
