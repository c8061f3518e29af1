"""Projection between the pixels of a sensor's camera and places in its gel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.sensing.geometry import Camera, FisheyeCamera, PinholeCamera, rotation
from tactile_nodes.sensors import CameraDescription, Sensor
from tactile_nodes.shapes import Float

DEPTHS = 5

MEETING = 12
"""Steps to find the intersection of a ray with a dome."""

DISPLACEMENT_MM = 1e-3

SAMPLED = 9
"""Pixels along each side of the image over which medians are taken."""


@dataclass(frozen=True)
class View:
    """The camera of a sensor and its gel.

    Pixels are those of the crop. Places (x, y) are in the surface frame.
    """

    sensor: Sensor

    @property
    def depths_mm(self) -> Float[np.ndarray, ' depths']:
        """Middles of five equal parts of the visible depth, from the surface down."""
        high, low = self.sensor.gel.markers_mm
        return np.asarray(high + (np.arange(DEPTHS) + 0.5) * (low - high) / DEPTHS)

    @property
    def middle_mm(self) -> float:
        """Depth of the middle of the visible part below the surface."""
        return float(self.depths_mm[DEPTHS // 2])

    @cached_property
    def px_per_mm(self) -> float:
        """Pixels of image motion per mm along x, at the middle depth of the markers (median), however it is rolled."""
        sides = [(np.arange(SAMPLED) + 0.5) / SAMPLED * size - 0.5 for size in self.sensor.image.crop_px]
        pixels = np.stack(np.meshgrid(*sides), -1).reshape(-1, 2)
        roll = math.radians(self.sensor.camera.roll_deg)
        moved = self.moves_at(self.met_at(pixels, self.middle_mm))[:, :, 0] @ [math.cos(roll), -math.sin(roll)]
        return float(np.median(np.abs(moved)))

    @property
    def marker_radius_px(self) -> float:
        """Radius of a described marker or dot."""
        return self.px_per_mm * sum(self.sensor.pattern.diameter_mm) / 4

    def shares_of(self, place_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
        """Image positions of places from `middle_seen_at`, as shares of the sides of the crop (x, y)."""
        return np.asarray((self.middle_seen_at(place_mm) + 0.5) / self.sensor.image.crop_px)

    def middle_seen_at(self, place_mm: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 2']:
        """Image positions [px] of places, at the middle depth of the markers."""
        return self.below_seen_at(place_mm, self.middle_mm)

    def below_seen_at(self, place_mm: Float[np.ndarray, 'n 2'], depth_mm: float) -> Float[np.ndarray, 'n 2']:
        """The same at a depth below the surface."""
        return self.seen_at(np.column_stack([place_mm, self.sensor.gel.dome.height_mm(place_mm) - depth_mm]))

    def seen_at(self, points_mm: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 2']:
        """Image positions [px] of points in the surface frame."""
        away = (points_mm - np.asarray(self.sensor.camera.position_mm, float)) @ self._turn
        return np.asarray(self._camera.project(away) - self._corner)

    def met_at(self, pixels: Float[np.ndarray, 'n 2'], depth_mm: float) -> Float[np.ndarray, 'n 3']:
        """Intersections of the rays of pixels with a depth, in the surface frame."""
        towards = self._camera.unproject(pixels + self._corner) @ self._turn.T
        place = np.asarray(self.sensor.camera.position_mm, float)
        forwards, height = np.maximum(towards[:, 2], 1e-3), np.zeros(len(towards))
        for _ in range(MEETING if self.sensor.gel.dome_radius_mm else 1):
            points: np.ndarray = place + towards * ((height - depth_mm - place[2]) / forwards)[:, None]
            height = self.sensor.gel.dome.height_mm(points[:, :2])
        return points

    def moves_at(self, points_mm: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 2 3']:
        """Pixels of image motion of points per mm along each axis."""
        steps = DISPLACEMENT_MM * np.eye(3)
        moved = [(self.seen_at(points_mm + each) - self.seen_at(points_mm - each)) / 2 for each in steps]
        return np.stack(moved, -1) / DISPLACEMENT_MM

    @property
    def _corner(self) -> Float[np.ndarray, ' 2']:
        """Upper left corner of the crop in the camera image [px]."""
        image = self.sensor.image
        return np.asarray((np.array([image.width, image.height]) - np.array(image.crop_px)) // 2, float)

    @cached_property
    def _camera(self) -> Camera:
        return camera_of(self.sensor.camera, self.sensor.image.width, self.sensor.image.height)

    @property
    def _turn(self) -> Float[np.ndarray, '3 3']:
        """The camera's axes in the surface frame, as columns."""
        return rotation(np.radians([*self.sensor.camera.tilt_deg, self.sensor.camera.roll_deg]))


def camera_of(camera: CameraDescription, width: int, height: int) -> Camera:
    """The described camera, with images of this size, in its own frame."""
    u, v = camera.centre_px
    if camera.model == 'pinhole':
        across, down = camera.focal_px
        return PinholeCamera(width, height, (across, down), (u, v), camera.distortion)
    return FisheyeCamera(width, height, camera.focal_px_per_rad, (u, v), camera.lens, camera.focal_ratio)
