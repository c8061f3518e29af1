"""Displacements of a layered gel under any load on its surface: one transform there and one back."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Inexact

from tactile_nodes.sensing.elasticity.stack import Elastic, Waves, waves_in

WIDTH_MM = 64.0
"""The layer repeats after so much, where a press is felt no more."""

EVEN = 16
"""Cells along each axis come in so many, so that patches of eight cells divide them, and so does the middle."""

WAVE_NUMBERS = 260


class ElasticLayer:
    """A gel's layers as seen at some depths, on a grid of `spacing_mm` (x, y), rows along y.

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
        """Where the nodes of the grid are."""
        x, y = ((np.arange(count) - count // 2) * step for count, step in zip(self.cells, self.spacing_mm, strict=True))
        return np.stack(np.meshgrid(x, y), -1)

    def points(
        self, place_mm: Float[np.ndarray, 'points 2'], force_n: Float[np.ndarray, ' points']
    ) -> Complex[np.ndarray, 'ky kx']:
        """The spectrum of forces at points about the middle, as shares of their sum."""
        along_x, along_y = np.fft.rfftfreq(self.cells[0], self.spacing_mm[0]), self._frequencies[1][:, 0]
        right, down = (
            np.exp(-2j * np.pi * k[:, None] * at) for k, at in zip((along_x, along_y), place_mm.T, strict=True)
        )
        spectrum: np.ndarray = (down * (force_n / force_n.sum())) @ right.T
        return spectrum

    @property
    def _frequencies(self) -> list[np.ndarray]:
        """Of the waves along x and along y, per mm."""
        along_x = np.fft.rfftfreq(self.cells[0], self.spacing_mm[0])
        return list(np.meshgrid(along_x, np.fft.fftfreq(self.cells[1], self.spacing_mm[1])))

    @cached_property
    def _grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Wave numbers, and their shares along x and y."""
        kx, ky = (2 * np.pi * each for each in self._frequencies)
        k = np.hypot(kx, ky)
        safe = np.where(k > 0, k, 1.0)
        return k, kx / safe, ky / safe

    @cached_property
    def _waves(self) -> Waves:
        """The functions of the stack on the grid, from their values at some wave numbers."""
        from scipy.interpolate import CubicSpline

        k = self._grid[0]
        known = np.concatenate([[1e-4], np.geomspace(0.02, 1.01 * k.max(), WAVE_NUMBERS)])
        found = waves_in(self._layers, known, self.depths_mm)
        at = np.log(np.maximum(k, 1e-4))
        spread = (CubicSpline(np.log(known), each)(at) for each in vars(found).values())
        return Waves(*spread)

    def kernels(
        self, spectrum: Inexact[np.ndarray, 'ky kx'], *, pressed_only: bool = False
    ) -> Float[np.ndarray, 'loads depths 3 y x']:
        """Displacements (x, y, z) about the middle under 1 N into the gel, along x and along y, of one shape.

        `spectrum` is that of the shape: the transform of how 1 N is spread, 1 at no wave number. `pressed_only` leaves
        out the two along the surface.
        """
        k, across, along = self._grid
        shift = (-1.0) ** np.arange(k.shape[1])[None] * (-1.0) ** np.arange(k.shape[0])[:, None]
        load = (spectrum * shift / (self.spacing_mm[0] * self.spacing_mm[1]))[..., None]
        x, y, w = across[..., None], along[..., None], self._waves
        pressed = load * -1j * w.pressed
        loads = [(x * pressed, y * pressed, -load * w.sinking)]
        for one, other, sign in () if pressed_only else ((x, y, -1.0), (y, x, 1.0)):
            # A force along an axis has a part along the wave and one across it.
            straight, aside = load * one * w.sheared, load * other * sign * w.across
            loads.append((x * straight - y * aside, y * straight + x * aside, -1j * load * one * w.dipping))
        for number in range(1, len(loads)):  # at no wave number all shear is alike
            loads[number][number - 1][0, 0] = load[0, 0] * w.across[0, 0]
        kernels = np.stack([np.stack(each) for each in loads])
        moved: np.ndarray = np.fft.irfft2(np.moveaxis(kernels, -1, 1), s=self.cells[::-1])
        return moved.astype(np.float32)

    def rectangle(self, width_mm: float, height_mm: float) -> Float[np.ndarray, 'ky kx']:
        """The spectrum of a force spread evenly over a rectangle."""
        along_x, along_y = self._frequencies
        spectrum: np.ndarray = np.sinc(along_y * height_mm) * np.sinc(along_x * width_mm)
        return spectrum
