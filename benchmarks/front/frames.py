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

SIDE, SEED = 440, 11
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


def frames(plan: Plan, *, tested_only: bool = False) -> Iterator[Frame]:
    """Frames of all presses; training and test have different rest images."""
    gel = Gel()
    table = contact_table(gel)
    optics = Optics(gel, table)
    for tested, number, press in _presses(plan):
        if tested_only and not tested:
            continue
        noise = 1_000_000 * (1 + tested) + 100 * number
        if number % ACROSS_REST_IMAGES == 0:
            rest = average([cropped(optics.render((), noise + 1 + i)) for i in range(16)])
        image = cropped(optics.render((press,), noise))
        yield Frame(image, rest, (press.x_mm, press.y_mm, press.depth_mm, table.force_at(press.depth_mm)))


def _presses(plan: Plan) -> Iterator[tuple[bool, int, Press]]:
    """Whether for the test, its number, and the press: within 27x27 mm and to 2 mm, or of depth -1, without contact."""
    random = np.random.default_rng(SEED)
    for tested, count in enumerate((plan.train, plan.test)):
        for number in range(count):
            x_mm, y_mm, depth_mm = random.uniform((-13.5, -13.5, 0.25 if tested else 0.05), (13.5, 13.5, 2.0))
            still = random.random() < STILL_SHARE
            yield bool(tested), number, Press(float(x_mm), float(y_mm), -1.0 if still else float(depth_mm))


def tested_presses(plan: Plan) -> list[Press]:
    """The presses of the test frames, without pictures; a depth below 0 touches nothing."""
    return [press for tested, _, press in _presses(plan) if tested]


def cropped(image: np.ndarray) -> np.ndarray:
    """The middle of a picture, as the models read it."""
    return np.ascontiguousarray(centre_crop(image, SIDE, SIDE))
