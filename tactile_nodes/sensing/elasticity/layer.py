"""Displacements of a layered gel under any load on its surface: one transform there and one back."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tactile_nodes.sensing.elasticity.stack import Elastic, Waves, waves_in

SPACING_MM, WIDTH_MM = 0.25, 64.0
"""Of the grid that loads are given on; the layer repeats after its width, where a press is felt no more."""

WAVE_NUMBERS = 260


class ElasticLayer:
    """A gel's layers as seen at some depths; the middle of the grid is the node `cells // 2`, rows along y."""

    def __init__(self, layers: Sequence[Elastic], depths_mm: Float[np.ndarray, ' depths']) -> None:
        self.cells = round(WIDTH_MM / SPACING_MM)
        self.depths_mm = np.asarray(depths_mm, float)
        self._layers = tuple(layers)

    @cached_property
    def _grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Wave numbers, and their shares along x and y."""
        kx, ky = np.meshgrid(
            2 * np.pi * np.fft.rfftfreq(self.cells, SPACING_MM), 2 * np.pi * np.fft.fftfreq(self.cells, SPACING_MM)
        )
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

    def kernels(self, spectrum: Float[np.ndarray, 'ky kx']) -> Float[np.ndarray, 'loads depths 3 y x']:
        """Displacements (x, y, z) about the middle under 1 N into the gel, along x and along y, of one shape.

        `spectrum` is that of the shape: the transform of how 1 N is spread, 1 at no wave number.
        """
        k, across, along = self._grid
        shift = (-1.0) ** np.arange(k.shape[1])[None] * (-1.0) ** np.arange(k.shape[0])[:, None]
        load = (spectrum * shift / SPACING_MM**2)[..., None]
        x, y, w = across[..., None], along[..., None], self._waves
        pressed = load * -1j * w.pressed
        loads = [(x * pressed, y * pressed, -load * w.sinking)]
        for one, other, sign in ((x, y, -1.0), (y, x, 1.0)):
            # A force along an axis has a part along the wave and one across it.
            straight, aside = load * one * w.sheared, load * other * sign * w.across
            loads.append((x * straight - y * aside, y * straight + x * aside, -1j * load * one * w.dipping))
        for number in (1, 2):  # at no wave number all shear is alike
            loads[number][number - 1][0, 0] = load[0, 0] * w.across[0, 0]
        kernels = np.stack([np.stack(each) for each in loads])
        moved: np.ndarray = np.fft.irfft2(np.moveaxis(kernels, -1, 1), s=(self.cells, self.cells))
        return moved.astype(np.float32)

    def square(self, side_mm: float) -> Float[np.ndarray, 'ky kx']:
        """The spectrum of a force spread evenly over a square."""
        kx = np.fft.rfftfreq(self.cells, SPACING_MM)
        ky = np.fft.fftfreq(self.cells, SPACING_MM)
        spectrum: np.ndarray = np.sinc(ky * side_mm)[:, None] * np.sinc(kx * side_mm)[None]
        return spectrum

    def hertz(self, radius_mm: float) -> Float[np.ndarray, 'ky kx']:
        """The spectrum of Hertz's pressure over a disc: 3 (sin x - x cos x) / x³, x = k radius."""
        x = np.maximum(self._grid[0] * radius_mm, 1e-2)
        exact = 3 * (np.sin(x) - x * np.cos(x)) / x**3
        spectrum: np.ndarray = np.where(self._grid[0] * radius_mm < 1e-2, 1.0, exact)
        return spectrum
