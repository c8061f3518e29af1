"""Random bodies to learn from: one to four simple shapes at random places, alike or not, some wavy or tilted.

The shapes are balls, discs, plates, rods and rings of random sizes. The ten families that contacts are tested with are
made of such shapes, too; their bodies have other sizes and seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tactile_nodes.simulation.touch.body import Body, grid
from tactile_nodes.simulation.touch.families import EDGE_MM, Heights, ball, rectangle, rod, rounded, torus

HALF_MM = 9.0
PARTS = 1, 1, 1, 2, 2, 3, 4
APART_MM = 2.0, 5.5
RAISED_MM = 0.2
ALIKE = 0.5
WAVY, WAVE_MM, WAVE_LENGTH_MM = 0.3, (0.1, 0.4), (1.2, 3.5)
TILTED, TILT_DEG = 0.4, 0.8

Shape = Callable[[np.random.Generator, Heights, Heights], Heights]


def _between(random: np.random.Generator, low: float, high: float) -> float:
    return float(random.uniform(low, high))


def _large_ball(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return ball(math.exp(_between(random, math.log(0.8), math.log(8.0))), x, y)


def _small_ball(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return ball(_between(random, 0.5, 1.5), x, y)


def _disc(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return rounded(np.hypot(x, y) - (_between(random, 0.7, 3.5) - EDGE_MM))


def _plate(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return rectangle(_between(random, 1.0, 8.0), _between(random, 1.0, 8.0), x, y)


def _rod(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return rod(_between(random, 2.0, 9.0), _between(random, 0.5, 3.0), x, y)


def _ring(random: np.random.Generator, x: Heights, y: Heights) -> Heights:
    return torus(_between(random, 1.5, 5.0), _between(random, 0.5, 1.5), x, y)


SHAPES: tuple[Shape, ...] = (_large_ball, _small_ball, _disc, _plate, _rod, _ring)


def random_body(random: np.random.Generator, *, single: bool = False) -> Body:
    """A body of random shape; of one part if `single`."""
    x, y = grid(HALF_MM)
    count = 1 if single else int(random.choice(PARTS))
    apart_mm = _between(random, *APART_MM) if count > 1 else 0.0
    form = random.spawn(1)[0]
    seed = int(form.integers(1 << 32)) if count > 1 and form.uniform() < ALIKE else None
    parts = [_part(random, np.random.default_rng(seed) if seed else random, x, y, apart_mm) for _ in range(count)]
    heights = np.min(parts, axis=0)
    if random.uniform() < WAVY:
        along = _turned(x, y, _between(random, 0, math.tau))[0]
        wave = 1 + np.sin(math.tau * along / _between(random, *WAVE_LENGTH_MM))
        heights = heights + _between(random, *WAVE_MM) / 2 * wave
    body = Body.of_heights('random', heights)
    if random.uniform() < TILTED:
        body = body.tilted(_between(random, -TILT_DEG, TILT_DEG), _between(random, -TILT_DEG, TILT_DEG))
    return body


def _part(random: np.random.Generator, form: np.random.Generator, x: Heights, y: Heights, apart_mm: float) -> Heights:
    """One shape (by `form`), turned and shifted; if there are others, also raised a little."""
    right, down = random.uniform(-apart_mm, apart_mm, 2)
    turned = _turned(x - right, y - down, _between(random, 0, math.tau))
    shape = SHAPES[int(form.integers(len(SHAPES)))]
    return shape(form, *turned) + (_between(random, 0.0, RAISED_MM) if apart_mm else 0.0)


def _turned(x: Heights, y: Heights, by_rad: float) -> tuple[Heights, Heights]:
    return math.cos(by_rad) * x + math.sin(by_rad) * y, math.cos(by_rad) * y - math.sin(by_rad) * x
