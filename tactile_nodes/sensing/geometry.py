"""Frames, bins, camera models, and the crop of the camera's image that is processed.

The surface frame has its origin at the centre of the gel's surface, x to the right in the image, y down in
the image, z out of the gel, away from the camera. Its axes are parallel to the camera's optical frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensors import ImageSettings, Sensor
from tactile_nodes.shapes import Float, UInt8


@dataclass(frozen=True)
class BinGrid:
    """The grid of bins on the surface. Index k = row * cols + col, rows along +y, columns along +x.

    The paper's 9x9 bins over the whole 32 mm surface are 3.556 mm wide; the centre of bin 0 lies at
    (-14.222, -14.222) mm and that of bin 40 at the origin.
    """

    rows: int = 9
    cols: int = 9
    width_mm: float = 32.0
    height_mm: float = 32.0
    centre_mm: tuple[float, float] = (0.0, 0.0)
    """Centre of the grid in the surface frame."""

    @classmethod
    def of_sensor(cls, sensor: Sensor) -> BinGrid:
        """The grid of a sensor description, over the gel's rectangle or over a separate one."""
        bins, gel = sensor.bins, sensor.gel
        x, y = bins.centre_mm
        return cls(bins.rows, bins.cols, bins.width_mm or gel.width_mm, bins.height_mm or gel.height_mm, (x, y))

    @classmethod
    def of_card(cls, card: Mapping[str, Any]) -> BinGrid:
        """The inverse of `card`. Raises KeyError, TypeError, ValueError: an entry is missing or invalid."""
        x, y = card.get('centre_mm', (0.0, 0.0))
        return cls(card['rows'], card['cols'], card['width_mm'], card['height_mm'], (float(x), float(y)))

    @property
    def card(self) -> dict[str, Any]:
        """The entries in model files and data sets. A centre at the origin is left out."""
        entries = asdict(self)
        if self.centre_mm == (0.0, 0.0):
            del entries['centre_mm']
        return entries

    @property
    def count(self) -> int:
        return self.rows * self.cols

    @property
    def bin_size_mm(self) -> tuple[float, float]:
        """Width (along x) and height (along y) of one bin."""
        return self.width_mm / self.cols, self.height_mm / self.rows

    @property
    def reach_mm(self) -> tuple[float, float]:
        """The largest |x| and |y| of a point on the bins."""
        (x, y) = self.centre_mm
        return abs(x) + self.width_mm / 2, abs(y) + self.height_mm / 2

    @property
    def origin_mm(self) -> tuple[float, float]:
        """The outer corner (x, y) of bin 0 in the surface frame: (-16, -16) for the paper's grid."""
        x, y = self.centre_mm
        return x - self.width_mm / 2, y - self.height_mm / 2

    @property
    def centres_mm(self) -> Float[np.ndarray, 'rows cols 2']:
        """Centre (x, y) of each bin in the surface frame."""
        width, height = self.bin_size_mm
        x = self.origin_mm[0] + (np.arange(self.cols) + 0.5) * width
        y = self.origin_mm[1] + (np.arange(self.rows) + 0.5) * height
        return np.stack(np.meshgrid(x, y), axis=-1)

    def bin_of(self, x_mm: float, y_mm: float) -> int:
        """Index of the bin that contains a point. A point outside the surface belongs to the nearest bin.

        For the paper's grid (0, 0) lies in bin 40, (-16, -16) in bin 0 and (15.9, -16) in bin 8.
        """
        width, height = self.bin_size_mm
        col = min(max(int((x_mm - self.origin_mm[0]) // width), 0), self.cols - 1)
        row = min(max(int((y_mm - self.origin_mm[1]) // height), 0), self.rows - 1)
        return row * self.cols + col

    def border_distance_mm(self, x_mm: float, y_mm: float) -> float:
        """Distance to the nearest border between two bins: 1.778 mm at the centre of the paper's bin 40."""
        inner_x = self.origin_mm[0] + np.arange(1, self.cols) * self.bin_size_mm[0]
        inner_y = self.origin_mm[1] + np.arange(1, self.rows) * self.bin_size_mm[1]
        return float(np.abs(np.concatenate([inner_x - x_mm, inner_y - y_mm])).min(initial=np.inf))


TABULATED, UNDISTORTING = 500, 5
"""Tabulated angles of a fisheye, and steps of Newton's method from the tabulated angle."""


@dataclass(frozen=True)
class FisheyeCamera:
    """An equidistant fisheye: a ray at angle theta to the optical axis lands r = focal * theta from the centre.

    Points are (x, y, z) in the optical frame (z forward), pixels (u, v) with the centre of the first pixel
    at (0, 0). With 300 px/rad a point at 45 degrees to the right lands 300 * pi/4 = 235.62 px from the centre.
    With `distortion` (k1 to k4 of OpenCV's fisheye and ROS's `equidistant`) theta is replaced by
    theta (1 + k1 theta² + k2 theta⁴ + k3 theta⁶ + k4 theta⁸): with k1 of 0.1 the same point lands 250.15 px away.
    `focal_ratio` is the focal length along v over that along u. Source: OpenCV, Fisheye camera model.
    """

    width: int = 640
    height: int = 480
    focal_px_per_rad: float = 300.0
    centre_px: tuple[float, float] = (319.5, 239.5)
    distortion: tuple[float, ...] = ()
    focal_ratio: float = 1.0

    def project(self, points: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 2']:
        """Pixel of each point. The scale of the points does not matter."""
        across = np.hypot(points[:, 0], points[:, 1])
        theta = np.arctan2(across, points[:, 2])
        if any(self.distortion):
            theta = theta * self._stretch(theta)[0]
        # theta / across tends to 1 / z on the axis; the maximum only avoids 0 / 0 there.
        scale = self.focal_px_per_rad * theta / np.maximum(across, np.finfo(points.dtype).tiny)
        plane = points[:, :2] * scale[:, None]
        if self.focal_ratio != 1:
            plane[:, 1] *= self.focal_ratio
        pixels: np.ndarray = plane + np.asarray(self.centre_px, points.dtype)
        return pixels

    def unproject(self, pixels: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 3']:
        """Unit vector along the ray of each pixel: (0.7071, 0, 0.7071) for the example above."""
        offset = pixels - np.asarray(self.centre_px, pixels.dtype)
        if self.focal_ratio != 1:
            offset[:, 1] /= self.focal_ratio
        radius = np.hypot(offset[:, 0], offset[:, 1])
        theta = radius / self.focal_px_per_rad
        if any(self.distortion):
            theta = self._angle(theta)
        sideways = offset * (np.sin(theta) / np.maximum(radius, np.finfo(pixels.dtype).tiny))[:, None]
        return np.column_stack([sideways, np.cos(theta)])

    def _stretch(self, theta: Float[np.ndarray, ' n']) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, ' n']]:
        """Ratio of the distorted angle to theta, and the derivative of the distorted angle."""
        square = theta * theta
        stretch, slope = np.zeros_like(theta), np.zeros_like(theta)
        for order in range(len(self.distortion), 0, -1):
            stretch = (stretch + self.distortion[order - 1]) * square
            slope = (slope + (2 * order + 1) * self.distortion[order - 1]) * square
        return 1 + stretch, 1 + slope

    def _angle(self, seen: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
        """The angle whose distorted angle is `seen`: by a table up to the angle at which the lens folds the image over,
        then by Newton's method."""
        known = np.linspace(0, np.pi, TABULATED).astype(seen.dtype)
        stretch, slope = self._stretch(known)
        unfolded = np.logical_and.accumulate(slope > 0)
        theta: np.ndarray = np.interp(seen, (known * stretch)[unfolded], known[unfolded]).astype(seen.dtype)
        for _ in range(UNDISTORTING):
            stretch, slope = self._stretch(theta)
            theta = theta - (theta * stretch - seen) / slope
        return theta


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole with the lens distortion of OpenCV and of ROS's `plumb_bob`: k1, k2, p1, p2, k3 (none: all 0).

    A point (x, y, z) lands at centre + focal * (x / z, y / z), with x / z and y / z distorted by the lens. With 300 px
    a point at 45 degrees to the right lands 300 px from the centre, and with k1 of 0.1 as well 330 px.
    Source: OpenCV, Camera Calibration and 3D Reconstruction; Brown (1966).
    """

    width: int = 640
    height: int = 480
    focal_px: tuple[float, float] = (600.0, 600.0)
    centre_px: tuple[float, float] = (319.5, 239.5)
    distortion: tuple[float, ...] = ()

    def project(self, points: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 2']:
        """Pixel of each point in front of the camera. The scale of the points does not matter."""
        plane = points[:, :2] / points[:, 2:]
        if any(self.distortion):
            k1, k2, p1, p2, k3 = self.distortion
            x, y = plane.T
            square = x * x + y * y
            radial = 1 + square * (k1 + square * (k2 + square * k3))
            plane = np.column_stack([
                x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ])  # fmt: skip
        focal, centre = (np.asarray(each, points.dtype) for each in (self.focal_px, self.centre_px))
        pixels: np.ndarray = plane * focal + centre
        return pixels

    def unproject(self, pixels: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'n 3']:
        """Unit vector along the ray of each pixel."""
        plane = (pixels - np.asarray(self.centre_px, pixels.dtype)) / np.asarray(self.focal_px, pixels.dtype)
        if any(self.distortion):
            import cv2

            until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)
            seen = plane[:, None], np.eye(3), np.array(self.distortion), np.eye(3), np.eye(3)
            in_opencv_4 = getattr(cv2, 'undistortPointsIter', None)
            plane = (in_opencv_4(*seen, until) if in_opencv_4 else cv2.undistortPoints(*seen, criteria=until))[:, 0]
        rays = np.column_stack([plane, np.ones(len(plane))])
        unit: np.ndarray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit


Camera = FisheyeCamera | PinholeCamera


def camera_motions(rows: int, cols: int, aspect: float = 1.0) -> Float[np.ndarray, 'cells 2 ways']:
    """Motion of the cells of a picture along x and y, row by row, as the camera moves right, moves down, rolls, or
    comes nearer. Each motion is 1 at the far edges of the picture; `aspect` is its width over its height."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    x, y = ((2 * col + 1) / cols - 1) * min(1.0, aspect), ((2 * row + 1) / rows - 1) / max(1.0, aspect)
    one, none = np.ones_like(x), np.zeros_like(x)
    ways: np.ndarray = np.array([[one, none], [none, one], [-y, x], [x, y]]).transpose(2, 1, 0)
    return ways


def rotation(angles: Float[np.ndarray, ' 3']) -> Float[np.ndarray, '3 3']:
    """Rotation Rx Ry Rz (rad). The columns are the turned axes: (0, 0, pi / 2) turns x (1, 0, 0) to (0, 1, 0)."""
    (a, b, c), (sa, sb, sc) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
    about_y = np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
    about_z = np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
    turned: np.ndarray = about_x @ about_y @ about_z
    return turned


@dataclass(frozen=True)
class Crop:
    """A rectangle of an image, in pixels from its upper left corner."""

    x: int
    y: int
    width: int
    height: int

    @classmethod
    def centred(cls, image_width: int, image_height: int, width: int = 440, height: int = 440) -> Crop:
        """The paper's crop: 440x440 from the middle of 640x480, that is Crop(x=100, y=20, ...).

        Raises:
            ImageError: the image is smaller than the crop.
        """
        if width > image_width or height > image_height:
            raise ImageError(
                f'cannot cut {width}x{height} pixels from an image of {image_width}x{image_height}; '
                'set the camera to a larger size or the crop to a smaller one; with a model of a described sensor, '
                'give its description too (sensor:=…)'
            )
        return cls((image_width - width) // 2, (image_height - height) // 2, width, height)

    def apply(self, image: UInt8[np.ndarray, 'h w *channels']) -> UInt8[np.ndarray, 'ch cw *channels']:
        """The rectangle as a view into the image.

        Raises:
            ImageError: the rectangle is not within the image.
        """
        height, width = image.shape[:2]
        if min(self.x, self.y) < 0 or self.x + self.width > width or self.y + self.height > height:
            raise ImageError(
                f'the crop {self.width}x{self.height} at ({self.x}, {self.y}) does not lie within '
                f'the image of {width}x{height} pixels; change the crop or the size of the camera image'
            )
        return image[self.y : self.y + self.height, self.x : self.x + self.width]


def largest_side(width: int, height: int, wanted: int, step: int = 40) -> int:
    """Side of the square to crop, in px: `wanted` if it fits, else the largest multiple of `step` that does.

    With 440 wanted, 640x480 gives 440, 320x240 gives 240 and 300x230 gives 200.

    Raises:
        ImageError: not even `step` pixels fit.
    """
    if (room := min(width, height)) >= wanted:
        return wanted
    if room < step:
        raise ImageError(f'an image of {width}x{height} pixels is too small; set the camera to a larger size')
    return room // step * step


def middle_part(
    image: UInt8[np.ndarray, 'h w'], side: int = 0, size: tuple[int, int] | None = None
) -> UInt8[np.ndarray, 'ch cw']:
    """The middle of a picture: a square of `side` pixels, or the largest that fits.

    With a side of 0 it is the rectangle of `size` (width, height), by default the paper's 440x440 px: 640x480 gives the
    same as `Crop.centred`. If that is a square, a square picture counts as cropped already and is returned unchanged,
    and a smaller one gives the largest square that fits: 320x240 gives 240x240.

    Raises:
        ImageError: the picture is too small.
    """
    height, width = image.shape
    size = size or (440, 440)
    if not side and size[0] != size[1]:
        return Crop.centred(width, height, *size).apply(image)
    if width == height and not side:
        return image
    side = largest_side(width, height, side or size[0])
    return Crop.centred(width, height, side, side).apply(image)


def described_part(image: UInt8[np.ndarray, 'h w'], described: ImageSettings) -> UInt8[np.ndarray, 'ch cw']:
    """The part that a description uses. A picture of another size stays whole: its crop would show another part."""
    if image.shape != (described.height, described.width):
        return image
    return centre_crop(image, *described.crop_px)


def grey(image: np.ndarray, order: str = 'bgr') -> UInt8[np.ndarray, 'h w']:
    """Luma 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601) of a colour image. A grey image is returned unchanged.

    A pure green pixel of 255 becomes 150. `order` is 'bgr' or 'rgb'.

    Raises:
        ImageError: the image does not have one, three or four channels, or is not 8 bit.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise ImageError(
            f'cannot make a grey image of an array of {image.dtype} with shape {image.shape}; '
            'give 8 bit images with one, three or four channels'
        )
    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[:, :, 0]
    return _luma(image, order)


def centre_crop(
    image: UInt8[np.ndarray, 'h w *channels'], width: int = 440, height: int = 440
) -> UInt8[np.ndarray, 'ch cw *channels']:
    """The middle of an image, cropped by `Crop.centred`."""
    return Crop.centred(image.shape[1], image.shape[0], width, height).apply(image)


def _luma(image: np.ndarray, order: str) -> np.ndarray:
    import cv2

    codes = {('bgr', 3): cv2.COLOR_BGR2GRAY, ('rgb', 3): cv2.COLOR_RGB2GRAY,
             ('bgr', 4): cv2.COLOR_BGRA2GRAY, ('rgb', 4): cv2.COLOR_RGBA2GRAY}  # fmt: skip
    converted: np.ndarray = cv2.cvtColor(image, codes[order, image.shape[2]])
    return converted
