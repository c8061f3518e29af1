"""The gel of `responding` under a tip that drags it: what that adds is known exactly, too."""

from __future__ import annotations

import numpy as np
from responding import AXES, COMPONENTS, GRID, components, response

from tactile_nodes.sensing.contact_drag import AMOUNTS, Drag, amounts
from tactile_nodes.sensing.splines import SplineAxis, value_and_slopes

GEL = response()
LEAST_GAIN = 12.0
"""Two numbers gain so much by noise once in 160 000 times: exp(-12)."""


def drag_of() -> Drag:
    """Regions near the tip go where it goes, the more the harder it presses; a tenth as much by the squares."""
    axes = [SplineAxis(axis.low, axis.high, intervals) for axis, intervals in zip(AXES, (8, 8, 2), strict=True)]
    x, y, s = (axis.low + (np.arange(axis.count) - 1) * (axis.high - axis.low) / axis.intervals for axis in axes)
    along = np.linspace(-11, 11, GRID)
    regions = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    away = regions[None, None] - np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1)[:, :, None]
    near = np.exp(-(away**2).sum(axis=-1) / (2 * 5.0**2))
    none = np.zeros_like(near)
    ways = [(near, none), (none, near), (0.1 * near, none), (none, 0.1 * near), (0.1 * near, 0.1 * near)]
    fields = np.stack([np.stack(way, axis=-1).reshape(len(x), len(y), -1) for way in ways], axis=2)
    mixtures = np.linalg.qr(np.random.default_rng(4).normal(size=(2 * GRID**2, COMPONENTS)))[0]
    table = np.einsum('ijac,ck,s->ijsak', fields, mixtures, np.cbrt(np.maximum(s, 0))) * 200.0
    return Drag(axes[0], axes[1], axes[2], table.astype(np.float16), LEAST_GAIN, most_mm=1.0, doubt_n=0.01)


DRAG = drag_of()


def pulled(x: float, y: float, s: float, pull_mm: tuple[float, float]) -> np.ndarray:
    """What a contact that drags makes."""
    added = value_and_slopes(DRAG.axes, DRAG.table, (x, y, s))[0].reshape(AMOUNTS, -1)
    return np.asarray(components(GEL, (x, y, s)) + amounts(np.array(pull_mm)) @ added, np.float32)
