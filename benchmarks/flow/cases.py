"""Images with known motion: simulated presses, a rest image moved by a formula, and published speckle images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.drivers.camera.pictures import read_grey
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.flow.patches import moved_image
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

SIDE = 440
LEAST_MARKERS = 3
DEPTHS_MM = {
    'at rest': (-1.0, -1.0),
    'to 0.25 mm': (0.02, 0.25),
    '0.25-0.5 mm': (0.25, 0.5),
    '0.5-1 mm': (0.5, 1.0),
    '1-1.5 mm': (1.0, 1.5),
    '1.5-2 mm': (1.5, 2.0),
}
RIGID_PX = (0.02, 0.1, 0.5, 2.0, 5.0, 10.0, 20.0, 30.0, 45.0)
DEEP_PX = ((3.0, 40.0), (6.0, 40.0), (12.0, 40.0), (10.0, 60.0), (20.0, 60.0), (30.0, 90.0))
SPECKLE_REST = '00'
SPECKLE_PX = {'04': 0.4, '08': 0.8, '10': 1.0, '25': 25.0, '50': 50.0}

Truth = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Case:
    """A rest image, an image, and the truth: motion (n, n, 2) in px of n x n regions, and which of them count."""

    rest: np.ndarray
    image: np.ndarray
    truth: Callable[[int], Truth]


class Sensor:
    """A gel (by default the default one), seen through the crop."""

    def __init__(self, gel: Gel | None = None) -> None:
        self.gel = gel = gel or Gel()
        self.optics = Optics(gel, contact_table(gel))
        corner = (gel.image_width - SIDE) / 2, (gel.image_height - SIDE) / 2
        self._corner = np.array(corner, np.float32)
        self._seen = self.optics.project(()) - self._corner
        self.rest = average([self.image((), 7 + number) for number in range(16)])

    def image(self, presses: tuple[Press, ...], seed: int) -> np.ndarray:
        """The crop of a camera image."""
        return seen_by(self.optics.render(presses, seed))

    def truth(self, presses: tuple[Press, ...], regions: int) -> Truth:
        """Mean motion of the markers that are in each region at rest; regions with three or more count."""
        moved = self.optics.project(presses) - self._corner - self._seen
        place = np.floor((self._seen + 0.5) * (regions / SIDE)).astype(int)
        inside = ((place >= 0) & (place < regions)).all(axis=1)
        number = place[inside, 1] * regions + place[inside, 0]
        count = np.bincount(number, minlength=regions**2)
        sums = np.stack([np.bincount(number, each, regions**2) for each in moved[inside].T], axis=-1)
        mean = sums / np.maximum(count, 1)[:, None]
        return mean.reshape(regions, regions, 2), (count >= LEAST_MARKERS).reshape(regions, regions)


def seen_by(camera_image: np.ndarray) -> np.ndarray:
    """The crop of a camera image."""
    return centre_crop(camera_image, SIDE, SIDE)


def pressed(sensor: Sensor, count: int) -> dict[str, Iterator[Case]]:
    """Presses at random places, by ranges of depth."""
    return {name: _presses(sensor, depths, count, lambda image: image) for name, depths in DEPTHS_MM.items()}


def disturbed(sensor: Sensor, count: int) -> dict[str, Iterator[Case]]:
    """Presses in another light, or out of focus."""
    changes: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        '30 % darker': lambda image: np.round(0.7 * image).astype(np.uint8),
        '30 % brighter': lambda image: np.clip(np.round(1.3 * image), 0, 255).astype(np.uint8),
        'blurred by 0.5 px': lambda image: cv2.GaussianBlur(image, (0, 0), 0.5),
        'blurred by 1 px': lambda image: cv2.GaussianBlur(image, (0, 0), 1.0),
    }
    return {f'0.25-0.5 mm, {name}': _presses(sensor, (0.25, 0.5), count, each) for name, each in changes.items()}


def _presses(
    sensor: Sensor, depths_mm: tuple[float, float], count: int, change: Callable[[np.ndarray], np.ndarray]
) -> Iterator[Case]:
    random = np.random.default_rng(41)
    for number in range(count):
        x_mm, y_mm = random.uniform(-13.5, 13.5, 2).tolist()
        presses = (Press(x_mm, y_mm, float(random.uniform(*depths_mm))),)
        image = change(sensor.image(presses, 1000 + number))
        yield Case(sensor.rest, image, partial(sensor.truth, presses))


def rigid(sensor: Sensor, count: int = 3, sizes_px: Sequence[float] = RIGID_PX) -> dict[str, Iterator[Case]]:
    """The rest image moved as a whole, to the right and up."""
    return {f'moved by {size:g} px': _rigid(sensor, size * 0.5**0.5, count) for size in sizes_px}


def _rigid(sensor: Sensor, each_px: float, count: int) -> Iterator[Case]:
    random = np.random.default_rng(42)
    light = moved_image(sensor.rest.astype(np.float32), each_px, -each_px)
    motion = np.empty((SIDE, SIDE, 2), np.float32)
    motion[:] = each_px, -each_px
    for _ in range(count):
        yield Case(sensor.rest, noisy(light, random), partial(_means, motion, 60))


def deep(sensor: Sensor, count: int = 3) -> dict[str, Iterator[Case]]:
    """The rest image expanded from a centre; each set has its largest motion and the distance of that, in pixels."""
    return {
        f'pushed apart by {most:g} px within {reach:g} px': _deep(sensor, most, reach, count) for most, reach in DEEP_PX
    }


def _deep(sensor: Sensor, most_px: float, reach_px: float, count: int) -> Iterator[Case]:
    random = np.random.default_rng(43)
    places = np.stack(np.meshgrid(*2 * [np.arange(SIDE, dtype=np.float32)]), axis=-1)
    for _ in range(count):
        offset = places - random.uniform(150, 290, 2).astype(np.float32)
        back = np.zeros_like(offset)
        for _ in range(60):  # find the origin of each pixel's content by damped iteration
            back += np.float32(0.7) * (apart(offset - back, most_px, reach_px) - back)
        across, down = cv2.split(places - back)
        rest = sensor.rest.astype(np.float32)
        light: np.ndarray = cv2.remap(rest, across, down, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)
        yield Case(sensor.rest, noisy(light, random), partial(_means, apart(offset, most_px, reach_px), 60))


def apart(offset_px: np.ndarray, most_px: float, reach_px: float) -> np.ndarray:
    """Outward motion: 0 at the centre, `most_px` at `reach_px` from it, fading as a Gaussian beyond."""
    squared = np.square(offset_px).sum(axis=-1, keepdims=True)
    motion: np.ndarray = offset_px * (np.float32(most_px / reach_px) * np.exp(0.5 - squared / (2 * reach_px**2)))
    return motion.astype(np.float32)


def noisy(light: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The light with the noise of the default gel's camera."""
    gel = Gel()
    spread = np.sqrt(gel.read_noise_grey**2 + gel.shot_noise_grey * np.maximum(light, 0))
    noise = random.standard_normal(light.shape) * spread
    image: np.ndarray = np.clip(np.round(light + noise), 0, 255).astype(np.uint8)
    return image


def _means(motion: np.ndarray, margin_px: int, regions: int) -> Truth:
    """Means by region; only regions well inside the image count, before and after the motion."""
    mean = cv2.resize(motion, (regions, regions), interpolation=cv2.INTER_AREA)
    height, width = motion.shape[:2]
    middle = np.dstack(np.meshgrid(*((np.arange(regions) + 0.5) * side / regions for side in (width, height))))
    far = np.array([width, height]) - margin_px
    inside = np.stack([(each >= margin_px) & (each <= far) for each in (middle, middle + mean)])
    counts: np.ndarray = np.all(inside, axis=(0, 3))
    return mean, counts


def known_shifts(folder: Path) -> dict[str, Iterator[Case]]:
    """Synthetic speckle images, moved right and up by known shifts.

    Raises:
        ConfigurationError: an image is missing in the folder, or is no image.
    """
    for frame in (SPECKLE_REST, *SPECKLE_PX):
        if not (file := _speckle_file(folder, frame)).is_file():  # before anything is measured
            raise ConfigurationError(f'there is no speckle image {file}; give --speckle the folder dic_rigid_shift')
    return {f'speckle moved by {size:g} px': _speckle(folder, frame, size) for frame, size in SPECKLE_PX.items()}


def _speckle(folder: Path, frame: str, size: float) -> Iterator[Case]:
    rest, image = (read_grey(_speckle_file(folder, each)) for each in (SPECKLE_REST, frame))
    motion = np.empty((*rest.shape, 2), np.float32)
    motion[:] = size, -size
    yield Case(rest, image, partial(_means, motion, 60))


def _speckle_file(folder: Path, frame: str) -> Path:
    return folder / f'rigid_cam0_frame{frame}.tiff'
