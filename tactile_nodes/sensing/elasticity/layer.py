"""Displacements of a layered gel under any load on its surface, by one forward and one inverse transform."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
import scipy.fft

from tactile_nodes.sensing.elasticity.stack import Elastic, Waves, waves_in
from tactile_nodes.shapes import Complex, Float, Float32, Inexact

WIDTH_MM = 64.0
"""Period of the layer; at this distance a press has no effect."""

EVEN = 16
"""Cells along each axis are a multiple of this, so that patches of eight cells and the middle divide them."""

WAVE_NUMBERS = 260

FAINT = 1e-3
"""Least share of a force on a node, over the largest."""


class ElasticLayer:
    """The layers of a gel, evaluated at some depths on a grid of `spacing_mm` (x, y), rows along y.

    The middle of the grid is the node `cells // 2` along each axis.
    """

    def __init__(
        self,
        layers: Sequence[Elastic],
        depths_mm: Float[np.ndarray, ' depths'],
        spacing_mm: tuple[float, float] = (0.25, 0.25),
        width_mm: float = WIDTH_MM,
    ) -> None:
        self.spacing_mm = spacing_mm
        along_x, along_y = (EVEN * round(width_mm / spacing / EVEN) for spacing in spacing_mm)
        self.cells = along_x, along_y
        self.depths_mm = np.asarray(depths_mm, float)
        self._layers = tuple(layers)

    @property
    def nodes_mm(self) -> Float[np.ndarray, 'y x 2']:
        """Positions of the grid's nodes."""
        x, y = ((np.arange(count) - count // 2) * step for count, step in zip(self.cells, self.spacing_mm, strict=True))
        return np.stack(np.meshgrid(x, y), -1)

    def points(
        self, place_mm: Float[np.ndarray, 'points 2'], force_n: Float[np.ndarray, ' points']
    ) -> Complex[np.ndarray, 'ky kx']:
        """The spectrum of point forces around the middle, as shares of their sum."""
        along_x, along_y = np.fft.rfftfreq(self.cells[0], self.spacing_mm[0]), self._frequencies[1][:, 0]
        right, down = (
            np.exp(-2j * np.pi * k[:, None] * at) for k, at in zip((along_x, along_y), place_mm.T, strict=True)
        )
        spectrum: np.ndarray = (down * (force_n / force_n.sum())) @ right.T
        return spectrum

    @property
    def _frequencies(self) -> tuple[np.ndarray, np.ndarray]:
        """Wave numbers along x and along y, per mm."""
        return _frequencies(self.spacing_mm, self.cells)

    @cached_property
    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions of the waves on the grid: unit vectors along x and y."""
        kx, ky = (2 * np.pi * each for each in self._frequencies)
        k = np.hypot(kx, ky)
        safe = np.where(k > 0, k, 1.0)
        return (kx / safe).astype(np.float32), (ky / safe).astype(np.float32)

    def kernels(
        self, spectrum: Inexact[np.ndarray, 'ky kx'], *, pressed_only: bool = False
    ) -> Float32[np.ndarray, 'depths 3 loads y x']:
        """Displacements (x, y, z) around the middle under 1 N into the gel, along x and along y, with one shape.

        `spectrum` is the transform of the shape over which 1 N is spread, 1 at wave number zero. `pressed_only` leaves
        out the two forces along the surface.
        """
        x, y = self._directions
        w = _waves(self._layers, tuple(self.depths_mm.tolist()), self.spacing_mm, self.cells)
        load = (spectrum * self._to_middle / (self.spacing_mm[0] * self.spacing_mm[1])).astype(np.complex64)
        moved = np.empty((len(self.depths_mm), 3, 1 if pressed_only else 3, *x.shape), np.complex64)
        pressed = load * -1j * w.pressed
        moved[:, 0, 0], moved[:, 1, 0], moved[:, 2, 0] = x * pressed, y * pressed, -load * w.sinking
        for number, (one, other, sign) in enumerate(() if pressed_only else ((x, y, -1.0), (y, x, 1.0)), 1):
            # A force along an axis has a part along the wave and a part across it.
            straight, aside = load * one * w.sheared, load * other * sign * w.across
            moved[:, 0, number], moved[:, 1, number] = x * straight - y * aside, y * straight + x * aside
            moved[:, 2, number] = -1j * load * one * w.dipping
            moved[:, number - 1, number, 0, 0] = load[0, 0] * w.across[:, 0, 0]  # no direction at wave number zero
        found: np.ndarray = scipy.fft.irfft2(moved, s=self.cells[::-1], overwrite_x=True)
        return found

    def forces(
        self, spectrum: Inexact[np.ndarray, 'ky kx']
    ) -> tuple[Float[np.ndarray, 'points 2'], Float[np.ndarray, ' points']]:
        """The nodes on which a force with this spectrum acts, and its share on each; without its faint remainder."""
        share = scipy.fft.irfft2(spectrum * self._to_middle, s=self.cells[::-1])
        there = share > FAINT * share.max()
        return self.nodes_mm[there], share[there] / share[there].sum()

    @property
    def _to_middle(self) -> Float[np.ndarray, 'ky kx']:
        """Signs of the waves that move the origin to the middle of the grid."""
        along_x, along_y = self._frequencies
        shift: np.ndarray = (-1.0) ** np.arange(along_x.shape[1])[None] * (-1.0) ** np.arange(along_y.shape[0])[:, None]
        return shift

    def rectangle(self, width_mm: float, height_mm: float) -> Float[np.ndarray, 'ky kx']:
        """The spectrum of a force spread evenly over a rectangle."""
        along_x, along_y = self._frequencies
        spectrum: np.ndarray = np.sinc(along_y * height_mm) * np.sinc(along_x * width_mm)
        return spectrum


def _frequencies(spacing_mm: tuple[float, float], cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    along_x = np.fft.rfftfreq(cells[0], spacing_mm[0])
    across, down = np.meshgrid(along_x, np.fft.fftfreq(cells[1], spacing_mm[1]))
    return across, down


@lru_cache(maxsize=8)
def _waves(
    layers: tuple[Elastic, ...], depths_mm: tuple[float, ...], spacing_mm: tuple[float, float], cells: tuple[int, int]
) -> Waves:
    """The functions of the stack at depths, on the grid of a layer, interpolated over wave numbers.

    They are cached: a calibration uses the same gel many times.
    """
    from scipy.interpolate import CubicSpline

    k = 2 * np.pi * np.hypot(*_frequencies(spacing_mm, cells))
    known = np.concatenate([[1e-4], np.geomspace(0.02, 1.01 * k.max(), WAVE_NUMBERS)])
    at = np.log(np.maximum(k, 1e-4))
    splines = (CubicSpline(np.log(known), each) for each in vars(waves_in(layers, known, np.array(depths_mm))).values())
    return Waves(*(np.ascontiguousarray(np.moveaxis(each(at), -1, 0), np.float32) for each in splines))
