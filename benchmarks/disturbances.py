"""Disturbances of a sensor, as functions of its gel and camera, of the incoming light, or of the picture.

Light is in grey levels before the camera's noise (float, not limited to 255); pictures are what the camera delivers.
All random values depend on a seed.
"""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np

from tactile_nodes.shapes import Bool, Float32, UInt8
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.optics import Optics, Press

SPOT_PX = 40.0
"""Standard deviation of a hot spot: the reflection of a lamp in the skin."""

DIRT_PX = (8.0, 24.0)
"""Smallest and largest radius of a speck of dirt; `DIRT_EDGE_PX` blurs its edge, because it is out of focus."""
DIRT_EDGE_PX = 3.0
DIRT_LIGHT = 0.1
"""The share of the light that a speck transmits."""

BAND_PX = 30.0
"""Height of one light and one dark band of a rolling shutter under a flickering lamp."""
BAND_STEP_PX = 11.3
"""Motion of the bands from frame to frame."""


def knocked(gel: Gel, shift_px: float) -> Gel:
    """The camera tilted, so that the middle of the picture moves by `shift_px` along the diagonal."""
    degrees = math.degrees(shift_px / math.sqrt(2) / gel.focal_px_per_rad)
    about_x, about_y = gel.camera_tilt_deg
    return dataclasses.replace(gel, camera_tilt_deg=(about_x + degrees, about_y + degrees))


def rolled(gel: Gel, degrees: float) -> Gel:
    """The camera turned about its axis."""
    return dataclasses.replace(gel, camera_roll_deg=gel.camera_roll_deg + degrees)


def magnified(gel: Gel, percent: float) -> Gel:
    """A longer focal length."""
    return dataclasses.replace(gel, focal_px_per_rad=gel.focal_px_per_rad * (1 + percent / 100))


def reseated(gel: Gel, shift_mm: float) -> Gel:
    """The gel put back with an offset of `shift_mm` along the diagonal; the camera sees it from another place."""
    right, down = gel.camera_shift_mm
    each = shift_mm / math.sqrt(2)
    return dataclasses.replace(gel, camera_shift_mm=(right + each, down + each))


def dimmed(gel: Gel, share: float) -> Gel:
    """A lamp that gives `share` of its light."""
    return dataclasses.replace(gel, light_gain=gel.light_gain * share)


def shrunk(gel: Gel, percent: float) -> Gel:
    """A soft layer thinner by `percent`, with its markers; negative values swell it."""
    return dataclasses.replace(gel, soft_mm=gel.soft_mm * (1 - percent / 100))


def warmed(gel: Gel, minutes: float) -> Gel:
    """A warm sensor: lens grown by 0.02 %, mount shifted by 0.15 px, lamp 5 % dimmer; the time constant is 15 min."""
    done = 1 - math.exp(-minutes / 15)
    return dimmed(knocked(magnified(gel, 0.02 * done), 0.15 * done), 1 - 0.05 * done)


def other_markers(gel: Gel, number: int = 0) -> Gel:
    """Another gel of the same kind."""
    return dataclasses.replace(gel, seed=gel.seed + 1000 + number)


def gone_anywhere(markers_mm: Float32[np.ndarray, 'markers 3'], share: float, seed: int = 1) -> Bool[np.ndarray, ' m']:
    """Markers missing at random."""
    gone = np.zeros(len(markers_mm), bool)
    gone[np.random.default_rng(seed).permutation(len(gone))[: round(share * len(gone))]] = True
    return gone


def gone_in_clusters(
    markers_mm: Float32[np.ndarray, 'markers 3'], share: float, seed: int = 1, radius_mm: float = 3.0
) -> Bool[np.ndarray, ' m']:
    """Markers missing in round holes at random places, until `share` of them is missing."""
    random, gone = np.random.default_rng(seed), np.zeros(len(markers_mm), bool)
    half = float(np.abs(markers_mm[:, :2]).max())
    while gone.mean() < share:
        away = markers_mm[:, :2] - random.uniform(-half, half, 2).astype(np.float32)
        gone |= np.hypot(away[:, 0], away[:, 1]) < radius_mm
    return gone


def gone_in_a_corner(markers_mm: Float32[np.ndarray, 'markers 3'], share: float) -> Bool[np.ndarray, ' m']:
    """Markers missing in a square corner with `share` of the surface."""
    half = float(np.abs(markers_mm[:, :2]).max())
    inside: np.ndarray = markers_mm[:, :2] > half - 2 * half * math.sqrt(share)
    gone: np.ndarray = np.logical_and(inside[:, 0], inside[:, 1])
    return gone


class WornOptics(Optics):
    """Renders a gel with some dark markers, and the light during an exposure."""

    def __init__(self, gel: Gel, tables: dict[str, ContactTable], gone: Bool[np.ndarray, ' m'] | None = None) -> None:
        super().__init__(gel, tables['tip'], {name: each for name, each in tables.items() if name != 'tip'})
        if gone is not None:
            self._light[gone] = 0
            self._rest = self._draw(self.project(()))
            self._last = (), self._rest

    def light(self, moments: tuple[tuple[Press, ...], ...]) -> Float32[np.ndarray, 'h w']:
        """The mean light over some moments of an exposure, before noise."""
        different = tuple(dict.fromkeys(moments))
        return self.radiance(different[0]) if len(different) == 1 else self._smeared(different)


def graded(light: Float32[np.ndarray, 'h w'], share: float) -> Float32[np.ndarray, 'h w']:
    """Light that is brighter by `share` at the right edge and darker by the same at the left."""
    slope: np.ndarray = light * np.linspace(1 - share, 1 + share, light.shape[1], dtype=np.float32)
    return slope


def with_hot_spot(
    light: Float32[np.ndarray, 'h w'], grey: float, place: tuple[float, float] = (0.4, 0.55)
) -> Float32[np.ndarray, 'h w']:
    """Light with a spot, brighter by `grey` at its middle, which is at the shares `place` of width and height."""
    height, width = light.shape
    across = np.exp(-0.5 * np.square((np.arange(width) - place[0] * width) / SPOT_PX))
    down = np.exp(-0.5 * np.square((np.arange(height) - place[1] * height) / SPOT_PX))
    spot: np.ndarray = light + (grey * np.outer(down, across)).astype(np.float32)
    return spot


def blurred(light: Float32[np.ndarray, 'h w'], sigma_px: float) -> Float32[np.ndarray, 'h w']:
    """Light out of focus: blurred by a Gaussian in addition to the lens's own blur."""
    soft: np.ndarray = cv2.GaussianBlur(light, (0, 0), sigma_px) if sigma_px > 0 else light
    return soft


def dirt(shape: tuple[int, int], share: float, seed: int = 1) -> Float32[np.ndarray, 'h w']:
    """Transmission of the lens (0.1 to 1) with specks of dirt on `share` of the picture."""
    random = np.random.default_rng(seed)
    height, width = shape
    specks = np.zeros(shape, np.float32)
    while specks.mean() < share:
        middle = int(random.integers(width)), int(random.integers(height))
        radius_px = min(random.uniform(*DIRT_PX), math.sqrt(share * height * width / math.pi))
        cv2.circle(specks, middle, round(radius_px), 1.0, cv2.FILLED)
    through: np.ndarray = 1 - (1 - DIRT_LIGHT) * cv2.GaussianBlur(specks, (0, 0), DIRT_EDGE_PX)
    return through.astype(np.float32)


def banded(light: Float32[np.ndarray, 'h w'], grey: float, number: int) -> Float32[np.ndarray, 'h w']:
    """Light with bands of rows, brighter and darker by up to `grey`, which move from frame to frame."""
    rows = np.arange(len(light)) + BAND_STEP_PX * number
    rolling: np.ndarray = light + (grey * np.sin(2 * np.pi * rows / (2 * BAND_PX))).astype(np.float32)[:, None]
    return rolling


def stuck_pixels(picture: UInt8[np.ndarray, 'h w'], share: float, grey: int, seed: int = 1) -> UInt8[np.ndarray, 'h w']:
    """A picture whose pixels at fixed random places always have the value `grey`."""
    stuck: np.ndarray = picture.copy()
    stuck[np.random.default_rng(seed).random(picture.shape, np.float32) < share] = grey
    return stuck


def noisier(gel: Gel, times: float) -> Gel:
    """A camera whose noise has `times` the standard deviation."""
    return dataclasses.replace(
        gel, read_noise_grey=gel.read_noise_grey * times, shot_noise_grey=gel.shot_noise_grey * times**2
    )
