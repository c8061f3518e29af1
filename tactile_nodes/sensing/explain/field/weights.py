"""How much each region counts: what its motion is expected to be off by, and what the camera's own motion explains.

A region is off by the frame's noise, by a share of its motion (what the response is off by), and by what its pattern
shows beyond a shift: where markers at different depths part, or the gel is stretched, the flow explains less of the
pattern and is off by so much more. Of what the camera itself moved nothing counts: with C the motion of the regions as
the camera moves, W the weights, the forces are found under W - W C (1 + C'WC)^-1 C'W, which is the same as to find
both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from tactile_nodes.sensing.explain.field.cone import inverse_root
from tactile_nodes.sensing.geometry import camera_motions

CAMERA_PX = 0.05
"""How far the camera moves by itself: what is more has been taken out of the picture before, as a knock."""

UNEXPLAINED_PX = 0.25
"""What a region is off by if nothing of its pattern is explained; so much less as more is.

Measured beside the true motion of each marker: 0.02 px where a twentieth is unexplained, 0.1 px where a quarter is.
"""

UNDISTURBED = 0.75
"""Of a frame's regions in the order of how well they are explained: what blur, darkness and noise take from all."""

CERTAIN, LOST = 0.3, 0.1
"""Confidence below which a region counts less, and up to which it counts next to nothing."""

LEAST_WEIGHT = 1e-3


def region_weights(
    motion: Float[np.ndarray, '*n regions 2'],
    confidence: Float[np.ndarray, '*n regions'],
    noise_px: float,
    doubt: float,
) -> Float[np.ndarray, '*n regions']:
    """One over the variance that is expected of regions' motion (1/px²)."""
    explained = np.sqrt(confidence)
    place = min(int(UNDISTURBED * explained.shape[-1]), explained.shape[-1] - 1)
    usual = np.partition(explained, place, axis=-1)[..., place : place + 1]
    left = np.clip(1 - explained / np.maximum(usual, 1e-6), 0.0, 1.0)
    found = np.clip((confidence - LOST) / (CERTAIN - LOST), LEAST_WEIGHT, 1.0)
    variance = noise_px**2 + np.square(UNEXPLAINED_PX * left) + doubt**2 * np.square(motion).sum(axis=-1)
    certainty: np.ndarray = found * found / variance
    return certainty


def camera_ways(shape: tuple[int, int], known: Int[np.ndarray, ' known']) -> Float[np.ndarray, 'rows 4']:
    """Motion (px) of some of rows x cols regions, along x and along y, as the camera moves right, moves down, rolls,
    and comes nearer, each by what is usual at the edge of the picture."""
    ways: np.ndarray = CAMERA_PX * camera_motions(*shape)[known]
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
        """From those of the regions, and their motion as the camera moves."""
        single = np.repeat(regions, 2)
        weighted = camera * single[:, None]
        shared = weighted @ inverse_root(np.eye(camera.shape[1]) + weighted.T @ camera).T
        return cls(single.astype(np.float32), np.ascontiguousarray(shared, np.float32))

    def times(self, motions: Float[np.ndarray, 'm rows']) -> Float[np.ndarray, 'm rows']:
        """Motions, weighted."""
        weighted: np.ndarray = motions * self.single - (motions @ self.shared) @ self.shared.T
        return weighted

    def among(self, motions: Float32[np.ndarray, 'm rows']) -> Float32[np.ndarray, 'm m']:
        """The lower half of motions' weighted products with each other, in Fortran's order; the upper half is 0."""
        from scipy.linalg.blas import ssyrk

        product: np.ndarray = ssyrk(1.0, (motions * np.sqrt(self.single)).T, trans=1, lower=1)
        without: np.ndarray = ssyrk(
            -1.0, (motions @ self.shared).T, trans=1, lower=1, beta=1.0, c=product, overwrite_c=1
        )
        return without

    def squared(self, motion: Float[np.ndarray, ' rows']) -> float:
        """The square of a motion under these weights: how much of it is more than expected."""
        camera = motion @ self.shared
        return max(float(self.single @ (motion * motion) - camera @ camera), 0.0)
