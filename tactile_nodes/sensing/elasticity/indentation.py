"""The frictionless pressure of a rigid body on a layer under a given force.

Conjugate gradients with p >= 0 and a given total (Polonsky and Keer 1999). The layer's response takes one forward and
one inverse transform. Linear elasticity: valid for small depths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft

from tactile_nodes.sensing.elasticity.layer import ElasticLayer
from tactile_nodes.shapes import Bool, Float

CLOSE, MOST_STEPS = 1e-5, 200
"""Stop when a step moves less than this share of the force between nodes; and the largest number of steps."""


@dataclass(frozen=True)
class Indentation:
    """A body pressed with a force: the force on each node of the surface, and the depth of the body.

    `force_n` sums to the total force. `depth_mm` is the depth of the body's lowest point below the surface at rest.
    """

    force_n: Float[np.ndarray, ' nodes']
    place_mm: Float[np.ndarray, 'nodes 2']
    depth_mm: float

    @property
    def centre_mm(self) -> Float[np.ndarray, ' 2']:
        """The centre of the pressure."""
        centre: np.ndarray = self.force_n @ self.place_mm / self.force_n.sum()
        return centre


class Indenter:
    """A body over a layer; only the layer's surface (depth 0) is used.

    `height_mm` is the height of the body's lower side over each node, the lowest being 0; not finite outside it.
    """

    def __init__(self, surface: ElasticLayer, height_mm: Float[np.ndarray, 'y x']) -> None:
        sinks = -surface.kernels(surface.rectangle(*surface.spacing_mm), pressed_only=True)[0, 2, 0].astype(float)
        body = np.isfinite(height_mm)
        box = tuple(slice(each.min(), each.max() + 1) for each in np.nonzero(body))
        self._body: Bool[np.ndarray, 'y x'] = body[box]
        self._height = np.where(self._body, height_mm[box], 0.0)
        self._nodes_mm = surface.nodes_mm[box]
        # Nodes of the body are less than its size apart, so the transform needs twice that at most, not all of the gel.
        sizes = zip(self._body.shape, sinks.shape, strict=True)
        self._period = tuple(min(scipy.fft.next_fast_len(2 * size, real=True), every) for size, every in sizes)
        near = tuple(
            slice(every // 2 - size // 2, every // 2 - size // 2 + size)
            for size, every in zip(self._period, sinks.shape, strict=True)
        )
        self._sinks = scipy.fft.rfft2(scipy.fft.ifftshift(sinks[near]))

    def pressed(self, force_n: float) -> Indentation:
        """The indentation under a force."""
        held = self._begin(force_n)
        way, slope = np.zeros(self._body.shape), 0.0
        for _ in range(MOST_STEPS):
            touches = held > 0
            gap = self._sunk(held) + self._height
            gap -= gap[touches].mean()
            steep = float(np.square(gap[touches]).sum())
            way = np.where(touches, gap + (steep / slope if slope else 0.0) * way, 0.0)
            moved = self._sunk(way)
            moved -= moved[touches].mean()
            step = float((gap * way)[touches].sum() / max((moved * way)[touches].sum(), 1e-30))
            found = np.where(touches, np.maximum(held - step * way, 0.0), 0.0)
            touched = self._body & (found == 0) & (gap < 0) & ~touches
            found[touched] = -step * gap[touched]
            slope = 0.0 if touched.any() else steep
            found *= force_n / found.sum()
            change, held = float(np.abs(found - held).sum()), found
            if change < CLOSE * force_n:
                break
        return self._indentation(held)

    def _begin(self, force_n: float) -> Float[np.ndarray, 'y x']:
        """Start with the force spread evenly over the body."""
        return np.where(self._body, force_n / np.count_nonzero(self._body), 0.0)

    def _sunk(self, force: np.ndarray) -> np.ndarray:
        """Downward displacement of the nodes under forces on them [mm]."""
        spectrum = self._sinks * scipy.fft.rfft2(force, s=self._period)
        sunk: np.ndarray = scipy.fft.irfft2(spectrum, s=self._period)[: force.shape[0], : force.shape[1]]
        return sunk

    def _indentation(self, held: np.ndarray) -> Indentation:
        touches = held > 0
        depth = float((self._sunk(held) + self._height)[touches].mean())
        return Indentation(held[touches], self._nodes_mm[touches], depth)
