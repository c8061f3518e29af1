"""The next press, chosen from those that were made, and the presses that are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.labels import outside
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.field.presses import Pressures
from tactile_nodes.learning.guided.watching import REGIONS
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Bool, Float

INNER = 0.8
"""Share of the gel's half sides that is pressed: near its rim a gel responds differently."""
STEP_MM = 0.5
NEAR_FORCE = 0.25
"""Relative difference up to which a press counts for a wanted force."""
NEAR_REGIONS = 3
"""Usable regions, of the nine around a place in the image, from which a press there is seen. The corners of the shipped
sensors have as many."""
LINEAR_SHARES = 0.5, 0.7, 0.85
"""Shares of the force up to which the layer is linear: light presses show little, and 15 % too much is still within."""


class Target(NamedTuple):
    """Where to press, mm from the centre of the gel, and how hard, N; or where was pressed, NaN if that is unknown."""

    x_mm: float
    y_mm: float
    force_n: float


@dataclass(frozen=True)
class Wish:
    """The wanted number of presses for some forces (N), wherever this sensor sees its gel and has bins."""

    presses: int
    forces_n: tuple[float, ...]
    sensor: Sensor

    def next(self, done: Sequence[Target], skipped: Sequence[Target] = ()) -> Target | None:
        """The place farthest from all presses and skipped places, with the force that was used least.

        None if no press is missing.
        """
        if len(done) >= self.presses:
            return None
        apart = distances(self.places, [*done, *skipped])
        x_mm, y_mm = self.places[int(np.argmax(apart))].tolist()
        counts = self.counts(done)
        return Target(x_mm, y_mm, self.forces_n[int(np.argmin(counts))])

    @cached_property
    def places(self) -> Float[np.ndarray, 'places 2']:
        """Places that may be pressed, those near the centre first.

        Raises:
            ConfigurationError: the camera sees none.
        """
        outline = self.sensor.gel.outline
        x, y = (_line(INNER * side / 2) for side in (outline.width_mm, outline.height_mm))
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        places = places[outline.holds(places / (INNER + 1e-9))]
        bins = BinGrid.of_sensor(self.sensor)
        places = places[[not outside(x_mm, y_mm, bins) for x_mm, y_mm in places.tolist()]]
        places = places[_seen(self.sensor, places)]
        if not len(places):
            raise ConfigurationError(
                f'the camera of {self.sensor.name} sees no place of the gel that could be pressed: correct mask, bins, '
                'gel and camera in its description (tactile sensor check draws them)'
            )
        return np.asarray(places[np.argsort(np.hypot(*places.T), kind='stable')])

    def counts(self, done: Sequence[Target]) -> list[int]:
        """The number of presses for each force; a press counts for the nearest one only."""
        nearest = [min(self.forces_n, key=lambda force: abs(each.force_n - force)) for each in done]
        near = [
            force for force, each in zip(nearest, done, strict=True) if abs(each.force_n - force) <= NEAR_FORCE * force
        ]
        return [near.count(force) for force in self.forces_n]

    def gap_mm(self, done: Sequence[Target]) -> float:
        """The largest distance from a place to its nearest press."""
        return float(distances(self.places, done).max())


def linear_most_n(sensor: Sensor, body: KnownBody) -> float:
    """The force (N) beyond which a calibration of the force field leaves a press out: 0.5 N of the paper's tip.

    Raises:
        ConfigurationError: the body is wider than the gel.
    """
    return Pressures(Regions(sensor, 1, 1), body).most_n


def digits(value: float, count: int = 3) -> str:
    """A number rounded to so many digits, below a million without an exponent: '1280' for 1275.3."""
    return f'{float(f"{value:.{count}g}"):g}'


def distances(places: Float[np.ndarray, 'places 2'], done: Sequence[Target]) -> Float[np.ndarray, ' places']:
    """The distance of each place to the nearest press; without presses the centre counts as farthest."""
    known = np.array([each[:2] for each in done if np.isfinite(each[:2]).all()]).reshape(-1, 2)
    if not len(known):
        return np.asarray(-np.hypot(*places.T))
    nearest: np.ndarray = np.linalg.norm(places[:, None] - known, axis=2).min(axis=1)
    return nearest


def _seen(sensor: Sensor, places: Float[np.ndarray, 'places 2']) -> Bool[np.ndarray, ' places']:
    """Which places the camera sees, with enough usable regions around them."""
    regions, (width, height) = Regions(sensor, REGIONS, REGIONS), sensor.image.crop_px
    pixels = np.rint(regions.view.middle_seen_at(places)).astype(int)
    inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
    x, y = np.clip(pixels, 0, (width - 1, height - 1)).T
    usable = np.pad(regions.usable.reshape(REGIONS, REGIONS), 1).astype(int)
    near = np.lib.stride_tricks.sliding_window_view(usable, (3, 3)).sum(axis=(2, 3))
    enough = near[y * REGIONS // height, x * REGIONS // width] >= NEAR_REGIONS
    return np.asarray(inside & ~sensor.covered[y, x] & enough)


def _line(reach_mm: float) -> Float[np.ndarray, ' n']:
    steps = int(reach_mm / STEP_MM)
    return np.arange(-steps, steps + 1) * STEP_MM
