"""Weights of the regions: the expected error of their motion, without the part that camera motion explains.

The error of a region has three parts: the frame's noise, a share of its motion (the error of the response), and a part
that the flow cannot explain. If markers at different depths separate, or the gel is stretched, the flow explains less
of the pattern and its error grows. Camera motion is excluded: with C the motion of the regions under camera motion and
W the weights, forces are solved with W - W C (1 + C'WC)^-1 C'W, which is equivalent to estimating both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.sensing.explain.field.cone import inverse_root
from tactile_nodes.sensing.geometry import camera_motions
from tactile_nodes.shapes import Float, Float32, Int

CAMERA_PX = 0.05
"""Usual motion of the camera; larger motion was removed from the image before, as a knock."""

UNEXPLAINED_PX = 0.25
"""Error of a region if none of its pattern is explained; it decreases in proportion to the explained share.

Measured against the true motion of each marker: 0.02 px if a twentieth is unexplained, 0.1 px for a quarter.
"""

UNDISTURBED = 0.75
"""Quantile of a frame's regions by explained share that gives the loss from blur, darkness and noise in all of them."""

CERTAIN, LOST = 0.3, 0.1
"""Confidence below which a region has less weight, and up to which it has almost none."""

LEAST_WEIGHT = 1e-3


def region_weights(
    motion: Float[np.ndarray, '*n regions 2'],
    confidence: Float[np.ndarray, '*n regions'],
    noise_px: float,
    doubt: float,
) -> Float[np.ndarray, '*n regions']:
    """One over the expected variance of the regions' motion [1/px²]."""
    explained = np.sqrt(confidence)
    place = min(int(UNDISTURBED * explained.shape[-1]), explained.shape[-1] - 1)
    usual = np.partition(explained, place, axis=-1)[..., place : place + 1]
    left = np.clip(1 - explained / np.maximum(usual, 1e-6), 0.0, 1.0)
    found = np.clip((confidence - LOST) / (CERTAIN - LOST), LEAST_WEIGHT, 1.0)
    variance = noise_px**2 + np.square(UNEXPLAINED_PX * left) + doubt**2 * np.square(motion).sum(axis=-1)
    certainty: np.ndarray = found * found / variance
    return certainty


def camera_ways(shape: tuple[int, int], known: Int[np.ndarray, ' known']) -> Float[np.ndarray, 'rows 4']:
    """Motion [px] of some of rows x cols regions, along x and along y, when the camera moves right, moves down, rolls,
    and comes nearer, each by its usual amount at the edge of the image. Regions are taken to be square."""
    rows, cols = shape
    ways: np.ndarray = CAMERA_PX * camera_motions(rows, cols, cols / rows)[known]
    return ways.reshape(-1, ways.shape[-1])


@dataclass(frozen=True)
class Weights:
    """Weights of the regions' motion along x and along y (1/px²), without what the camera's motion explains.

    `shared` is K of W - K K'.
    """

    single: Float32[np.ndarray, ' rows']
    shared: Float32[np.ndarray, 'rows ways']

    @classmethod
    def of(cls, regions: Float[np.ndarray, ' regions'], camera: Float[np.ndarray, 'rows ways']) -> Weights:
        """Weights from those of the regions, and their motion under camera motion."""
        single = np.repeat(regions, 2)
        weighted = camera * single[:, None]
        shared = weighted @ inverse_root(np.eye(camera.shape[1]) + weighted.T @ camera).T
        return cls(single.astype(np.float32), np.ascontiguousarray(shared, np.float32))

    def times(self, motions: Float[np.ndarray, 'm rows']) -> Float[np.ndarray, 'm rows']:
        """Motions, weighted."""
        weighted: np.ndarray = motions * self.single - (motions @ self.shared) @ self.shared.T
        return weighted

    def among(self, motions: Float32[np.ndarray, 'm rows']) -> Float32[np.ndarray, 'm m']:
        """Lower half of the weighted products of motions, in Fortran order; the upper half is 0."""
        from scipy.linalg.blas import ssyrk

        product: np.ndarray = ssyrk(1.0, (motions * np.sqrt(self.single)).T, trans=1, lower=1)
        without: np.ndarray = ssyrk(
            -1.0, (motions @ self.shared).T, trans=1, lower=1, beta=1.0, c=product, overwrite_c=1
        )
        return without

    def squared(self, motion: Float[np.ndarray, ' rows']) -> float:
        """The weighted square of a motion, in units of its expected variance."""
        camera = motion @ self.shared
        return max(float(self.single @ (motion * motion) - camera @ camera), 0.0)
