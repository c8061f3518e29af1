"""The rays of a part of the image that moves as one: a window of texture, or a printed dot.

A window or a dot sees a column of the gel along its rays. Its motion is the mean, over rays and depths, of the gel's
displacement as the camera projects it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.elasticity.view import DEPTHS, View
from tactile_nodes.shapes import Float

ALONG = 3
"""Rays along each side of a window, or of the square within a dot."""

IN_DOT = 0.612
"""Distance of the rays from the middle of a dot, over its radius. Nine of them have the variance of the disc (a quarter
of the squared radius along each axis)."""


@dataclass(frozen=True)
class Rays:
    """Rays of each window or dot, as pixels of the crop."""

    view: View
    pixels: Float[np.ndarray, 'parts rays 2']

    def __len__(self) -> int:
        """Number of windows or dots."""
        return len(self.pixels)

    @cached_property
    def points_mm(self) -> Float[np.ndarray, 'depths parts rays 3']:
        """Intersections of the rays with the depths."""
        flat = self.pixels.reshape(-1, 2)
        points = np.stack([self.view.met_at(flat, float(depth)) for depth in self.view.depths_mm])
        return points.reshape(DEPTHS, *self.pixels.shape[:2], 3)

    @cached_property
    def px_per_mm(self) -> Float[np.ndarray, 'depths parts rays 2 3']:
        """Pixels of image motion per mm along the surface above, and out of it.

        Deeper points follow the flat base more closely.
        """
        points, gel = self.points_mm, self.view.sensor.gel
        moved = self.view.moves_at(points.reshape(-1, 3)).reshape(*points.shape[:3], 2, 3)
        if not gel.dome_radius_mm:
            return moved
        places = points[..., :2]
        share = 1 - self.view.depths_mm[:, None, None] / (gel.depth_mm + gel.dome.height_mm(places))
        return np.asarray(moved @ gel.dome.axes(places, share))


def of_windows(view: View, shape: tuple[int, int], share: float) -> Rays:
    """Rays of rows x cols regions of the image, with windows of `share` times their sides."""
    side = np.array(view.sensor.image.crop_px) / np.array(shape[::-1])
    within = share * ((np.arange(ALONG) + 0.5) / ALONG - 0.5)
    v, u = (
        size * (np.arange(count)[:, None] + 0.5 + within) - 0.5
        for size, count in zip(side[::-1], shape, strict=True)
    )  # fmt: skip
    whole = *shape, ALONG, ALONG
    across, down = np.broadcast_to(u[None, :, None, :], whole), np.broadcast_to(v[:, None, :, None], whole)
    return Rays(view, np.stack([across, down], -1).reshape(-1, ALONG * ALONG, 2))


def of_dots(view: View) -> Rays:
    """Rays of the described dots."""
    steps = IN_DOT * view.marker_radius_px * np.arange(-1, 2)
    within = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return Rays(view, described_dots(view)[:, None] + within)


def described_dots(view: View) -> Float[np.ndarray, 'dots 2']:
    """Positions in the image [px] of the described dots whose whole disc is in it and uncovered."""
    sensor = view.sensor
    lattice = sensor.gel.outline.lattice_mm(sensor.pattern.pitch_mm, sensor.pattern.dot_mm)
    places = view.middle_seen_at(lattice)
    radius, size = view.marker_radius_px, np.array(sensor.image.crop_px)
    inside = ((places > radius) & (places < size - 1 - radius)).all(axis=1)
    places, lattice = places[inside], lattice[inside]
    # The distortion of a lens holds within the image only; it may also put dots there that lie far outside its view.
    off_mm = np.hypot(*(view.met_at(places, view.middle_mm)[:, :2] - lattice).T)
    near = np.rint(places).astype(int)
    return np.asarray(places[~sensor.covered[near[:, 1], near[:, 0]] & (off_mm < sensor.pattern.pitch_mm / 2)])


def dot_place_mm(view: View, centres_px: Float[np.ndarray, 'dots 2']) -> tuple[float, float]:
    """Position (x, y) on the surface of one of the dots in an image, within half a pitch of the middle.

    It is the value of `pattern.dot_mm` that fits the dots best: the mean of the values from each dot.
    """
    pitch_mm = view.sensor.pattern.pitch_mm
    turns = np.exp(2j * np.pi * view.met_at(centres_px, view.middle_mm)[:, :2] / pitch_mm).mean(axis=0)
    x, y = (np.angle(turns) / (2 * np.pi) * pitch_mm).tolist()
    return x, y
