"""The frames of `tactile bench front`: presses and rest images that all contenders measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

SIDE = 440
STILL_SHARE = 0.1
ACROSS_REST_IMAGES = 100
"""Number of frames with the same rest image."""


@dataclass(frozen=True)
class Plan:
    """Numbers of training and test frames, and whether to include slow methods, networks and compiled loops."""

    train: int = 1500
    test: int = 400
    slow: bool = True
    networks: bool = False
    compiled: bool = True


@dataclass(frozen=True)
class Frame:
    """An image, its rest image, and the tip's x, y, depth (mm) and force (N)."""

    image: np.ndarray
    rest: np.ndarray
    press: tuple[float, float, float, float]


def frames(plan: Plan, seed: int = 11, *, tested_only: bool = False) -> Iterator[Frame]:
    """Presses within 27x27 mm and to 2 mm, and frames at rest; training and test have different rest images."""
    gel = Gel()
    table = contact_table(gel)
    optics, random = Optics(gel, table), np.random.default_rng(seed)
    for phase, count in enumerate((plan.train, plan.test)):
        for number in range(count):
            x_mm, y_mm, depth_mm = random.uniform((-13.5, -13.5, 0.05 if phase == 0 else 0.25), (13.5, 13.5, 2.0))
            if random.random() < STILL_SHARE:
                depth_mm = -1.0
            if phase == 0 and tested_only:
                continue
            noise = 1_000_000 * (phase + 1) + 100 * number
            if number % ACROSS_REST_IMAGES == 0:
                rest = average([_crop(optics.render((), noise + 1 + i)) for i in range(16)])
            image = _crop(optics.render((Press(float(x_mm), float(y_mm), float(depth_mm)),), noise))
            yield Frame(image, rest, (x_mm, y_mm, depth_mm, table.force_at(float(depth_mm))))


def _crop(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(centre_crop(image, SIDE, SIDE))
