"""Bodies by name: the ten families of contacts that the force field is evaluated on, each in many variants.

`make_body('ring')` is the usual ring; with a random generator its sizes vary.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Float
from tactile_nodes.simulation.touch.body import Body, grid

EDGE_MM = 0.3
"""Radius by which the edges of flat bodies are rounded."""

Heights = Float[np.ndarray, 'n n']
Random = np.random.Generator | None


def ball(radius_mm: float, x: Heights, y: Heights) -> Heights:
    """The lower half of a sphere that rests on the origin."""
    away = x * x + y * y
    inside = away < radius_mm**2
    return np.where(inside, radius_mm - np.sqrt(np.where(inside, radius_mm**2 - away, 0.0)), np.inf)


def rounded(outside: Heights, edge_mm: float = EDGE_MM) -> Heights:
    """A flat side with a rounded edge, from the distance to the flat part (negative within it)."""
    beyond = np.clip(outside, 0.0, edge_mm)
    return np.where(outside < edge_mm, edge_mm - np.sqrt(edge_mm**2 - beyond**2), np.inf)


def rod(length_mm: float, radius_mm: float, x: Heights, y: Heights) -> Heights:
    """A rod with round ends along x."""
    return ball(radius_mm, np.maximum(np.abs(x) - length_mm / 2, 0.0), y)


def rectangle(width_mm: float, length_mm: float, x: Heights, y: Heights) -> Heights:
    """A flat rectangle with rounded edges."""
    beyond = np.maximum(np.abs(x) - (width_mm / 2 - EDGE_MM), 0), np.maximum(np.abs(y) - (length_mm / 2 - EDGE_MM), 0)
    return rounded(np.hypot(*beyond))


def torus(radius_mm: float, thickness_mm: float, x: Heights, y: Heights) -> Heights:
    """A ring of round wire: radius to the middle of the wire, and thickness of the wire."""
    return ball(thickness_mm, np.hypot(x, y) - radius_mm, np.zeros_like(x))


def teeth(length_mm: float, width_mm: float, pitch_mm: float, deep_mm: float, x: Heights, y: Heights) -> Heights:
    """A blade with teeth along x."""
    saw = deep_mm * np.abs(2 * np.mod(x / pitch_mm, 1.0) - 1)
    within = (np.abs(x) <= length_mm / 2) & (np.abs(y) <= width_mm / 2)
    return np.where(within, saw, np.inf)


def thread(length_mm: float, radius_mm: float, pitch_mm: float, deep_mm: float, x: Heights, y: Heights) -> Heights:
    """A screw along x."""
    return rod(length_mm, radius_mm, x, y) + deep_mm / 2 * (1 + np.sin(2 * np.pi * x / pitch_mm))


def _vary(random: Random, usual: float) -> float:
    """A size varied by up to a quarter."""
    return usual if random is None else usual * float(random.uniform(0.75, 1.25))


def _several(count: int, radius_mm: float, apart_mm: float, random: Random) -> Callable[[Heights, Heights], Heights]:
    """Balls evenly spaced on a circle, at slightly different heights."""
    turn = np.arange(count) * 2 * np.pi / count
    radii = [_vary(random, radius_mm) for _ in turn]
    raised = [0.0 if random is None else float(random.uniform(0.0, 0.1)) for _ in turn]
    away = _vary(random, apart_mm)

    def heights(x: Heights, y: Heights) -> Heights:
        each = [
            ball(radius, x - away * np.cos(a), y - away * np.sin(a)) + up
            for a, radius, up in zip(turn, radii, raised, strict=True)
        ]
        lowest: Heights = np.min(each, axis=0)
        return lowest

    return heights


def _tip(_: Random) -> Body:
    return _body_of(2.0, lambda x, y: ball(0.6, x, y))


def _ball(random: Random) -> Body:
    radius_mm = _vary(random, 5.0)
    return _body_of(8.0, lambda x, y: ball(radius_mm, x, y))


def _punch(random: Random) -> Body:
    radius_mm = _vary(random, 1.5)
    return _body_of(4.0, lambda x, y: rounded(np.hypot(x, y) - (radius_mm - EDGE_MM)))


def _tilted_square(random: Random) -> Body:
    side_mm = _vary(random, 6.0)
    tilt = (0.6, 0.3) if random is None else random.uniform(-0.8, 0.8, 2)
    return _body_of(5.0, lambda x, y: rectangle(side_mm, side_mm, x, y)).tilted(float(tilt[0]), float(tilt[1]))


def _ring(random: Random) -> Body:
    radius_mm = _vary(random, 4.0)
    return _body_of(8.0, lambda x, y: torus(radius_mm, 1.0, x, y))


def _edge(random: Random) -> Body:
    length_mm = _vary(random, 14.0)
    return _body_of(11.0, lambda x, y: rod(length_mm, 0.8, x, y))


def _two(random: Random) -> Body:
    return _body_of(8.0, _several(2, 2.0, 3.0, random))


def _three(random: Random) -> Body:
    return _body_of(8.0, _several(3, 1.5, 3.4, random))


def _blade(random: Random) -> Body:
    pitch_mm = _vary(random, 2.4)
    return _body_of(9.0, lambda x, y: teeth(12.0, 2.5, pitch_mm, 0.4, x, y))


def _screw(random: Random) -> Body:
    radius_mm = _vary(random, 1.5)
    return _body_of(10.0, lambda x, y: thread(12.0, radius_mm, 1.25, 0.25, x, y))


def _body_of(half_mm: float, heights: Callable[[Heights, Heights], Heights]) -> Body:
    return Body.of_heights('', heights(*grid(half_mm)))


FAMILIES: dict[str, Callable[[Random], Body]] = {
    'tip': _tip,
    'ball': _ball,
    'punch': _punch,
    'square': _tilted_square,
    'ring': _ring,
    'edge': _edge,
    'two': _two,
    'three': _three,
    'blade': _blade,
    'screw': _screw,
}
"""Round tip, large ball, flat punch, tilted square, ring, edge, two and three balls, toothed blade, lying screw."""


def make_body(name: str, random: Random = None) -> Body:
    """The usual body of a family, or a random variant.

    Raises:
        ConfigurationError: there is no such family.
    """
    if name not in FAMILIES:
        raise ConfigurationError(f'there is no body {name!r}; there are: {", ".join(FAMILIES)}')
    return replace(FAMILIES[name](random), name=name)
