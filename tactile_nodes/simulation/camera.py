"""The camera under the gel: its pose, the brightness of its image, and image compression."""

from __future__ import annotations

import cv2
import numpy as np

from tactile_nodes.sensing.geometry import Camera, FisheyeCamera, PinholeCamera, rotation
from tactile_nodes.shapes import Float32, UInt8
from tactile_nodes.simulation.gel import Gel


def camera_of(gel: Gel) -> Camera:
    """The camera under a gel, looking along +z at the middle of its surface."""
    right, down = gel.centre_shift_px
    size, centre = (gel.image_width, gel.image_height), (
        (gel.image_width - 1) / 2 + right, (gel.image_height - 1) / 2 + down,
    )  # fmt: skip
    if gel.camera == 'pinhole':
        focal_px = gel.focal_px_per_rad, gel.focal_px_per_rad * gel.focal_ratio
        return PinholeCamera(*size, focal_px, centre, gel.distortion)
    return FisheyeCamera(*size, gel.focal_px_per_rad, centre, gel.distortion[:4], gel.focal_ratio)


def shade(gel: Gel) -> Float32[np.ndarray, 'h w']:
    """Brightness over the image: `light_gain` in the middle, `1 - vignetting` of that at half the image's height
    from it, times the light's slope."""
    y, x = np.mgrid[: gel.image_height, : gel.image_width].astype(np.float32)
    x, y = x - (gel.image_width - 1) / 2, y - (gel.image_height - 1) / 2
    falloff = 1 / (1 + gel.vignetting / (1 - gel.vignetting) * (x**2 + y**2) / (gel.image_height / 2) ** 2)
    right, down = gel.light_slope
    slope = 1 + right * x / (gel.image_width / 2) + down * y / (gel.image_height / 2)
    shaded: np.ndarray = falloff * np.maximum(slope, 0) * gel.light_gain
    return shaded.astype(np.float32)


def camera_turn(gel: Gel) -> Float32[np.ndarray, '3 3'] | None:
    """The rotation from the surface's axes to the camera's; multiply row vectors with it from the right.

    The camera is tilted about its x and then its y axis, then rolled about z. None if it looks straight up.
    Rolled by 90 degrees it sees what is right of the middle (x > 0) above it (v < 0).
    """
    angles = (*gel.camera_tilt_deg, gel.camera_roll_deg)
    if not any(angles):
        return None
    return rotation(np.radians(angles)).astype(np.float32)


def pupil(gel: Gel) -> Float32[np.ndarray, ' 3']:
    """The camera's pupil in the surface frame."""
    return np.array([*gel.camera_shift_mm, gel.pupil_z_mm], np.float32)


def through_jpeg(image: UInt8[np.ndarray, 'h w'], quality: int) -> UInt8[np.ndarray, 'h w']:
    """The image after a camera's JPEG compression (quality 1 to 100) and the host's decoding."""
    _, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
