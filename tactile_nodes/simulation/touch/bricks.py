"""A layer of rubber in brick elements: its forces at finite strain, and its exact linear response.

It is bonded below, free above and periodic sideways.

The material is incompressible neo-Hookean, with one pressure a brick (Q1/P0). Per volume at rest its energy over the
shear modulus is

    W = (I1 - 3) / 2 - ln J + p (J - 1) - p² / (2 k)

averaged over a brick's eight integration points, with k the `volume_stiffness`. About the layer at rest the forces are
those of the linear layer, which is a separate matrix for each pair of wave numbers. Inverted once, it gives the
response to any load with one forward and one inverse transform. Lengths are in mm, stresses over the shear modulus
`UNIT`, forces in mm².
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.fft

from tactile_nodes.shapes import Complex64, Float, Float32

POINTS = np.array([-1.0, 1.0]) / 3**0.5
SHARES = np.stack([(1 - POINTS) / 2, (1 + POINTS) / 2], -1)
"""Weight of each of the two nodes of a line at each of its two integration points."""

LEAST_VOLUME = 0.05


@dataclass(frozen=True)
class Layer:
    """Division of the layer: `cells` x `cells` bricks sideways, `rows` down, each thicker by the factor `growth`."""

    cells: int = 96
    spacing_mm: float = 5 / 12
    thickness_mm: float = 6.0
    rows: int = 9
    growth: float = 1.25
    volume_stiffness: float = 2000.0

    @property
    def width_mm(self) -> float:
        """Period of the layer: 40 mm."""
        return self.cells * self.spacing_mm

    @property
    def z_mm(self) -> Float[np.ndarray, ' nodes']:
        """Heights of the nodes, from the base to the surface at 0."""
        thick = self.growth ** np.arange(self.rows)[::-1]
        heights: np.ndarray = np.concatenate([[0.0], np.cumsum(thick)]) * self.thickness_mm / thick.sum()
        return heights - self.thickness_mm

    @property
    def line_mm(self) -> Float[np.ndarray, ' cells']:
        """Positions of the nodes along x or y; 0 is one of them."""
        return (np.arange(self.cells) - self.cells // 2) * self.spacing_mm


@dataclass
class State:
    """Displacement of every node (mm; the base stays) and pressure of every brick (over the unit)."""

    moved: Float32[np.ndarray, 'nodes 3 y x']
    pressure: Float32[np.ndarray, 'rows y x']


class Bricks:
    """The forces of a layer, and its linear response."""

    def __init__(self, layer: Layer) -> None:
        self.layer = layer
        self._thick = np.diff(layer.z_mm).astype(np.float32)
        self._volume = (layer.spacing_mm**2 * self._thick)[:, None, None]

    def at_rest(self) -> State:
        """The untouched layer."""
        shape = self.layer.cells, self.layer.cells
        return State(
            np.zeros((self.layer.rows + 1, 3, *shape), np.float32), np.zeros((self.layer.rows, *shape), np.float32)
        )

    def forces(self, state: State) -> tuple[Float32[np.ndarray, 'rows 3 y x'], Float32[np.ndarray, 'rows y x'], float]:
        """Forces of the layer on its nodes above the base, volume that each brick lacks, and least volume ratio."""
        slopes = self._slopes(state.moved)
        sums: list[dict[tuple[int, int], np.ndarray]] = [{}, {}, {}]
        volume, least = np.zeros_like(state.pressure), np.inf
        for i, j, k in np.ndindex(2, 2, 2):
            pairs = [(j, k), (i, k), (i, j)]
            f = [slopes[axis][pairs[axis]] for axis in range(3)]
            stress, ratio = self._stress(f, state.pressure)
            volume += ratio
            least = min(least, float(ratio.min()))
            for axis in range(3):
                sums[axis][pairs[axis]] = sums[axis].get(pairs[axis], 0) + stress[axis]
        lacking = self._volume * (volume / 8 - 1 - state.pressure / np.float32(self.layer.volume_stiffness))
        return self._on_nodes(sums)[1:], lacking, least

    def _slopes(self, moved: np.ndarray) -> list[dict[tuple[int, int], np.ndarray]]:
        """Derivatives of displacement along x, y and z, each at the 2x2 integration points of the other two axes."""
        h = np.float32(self.layer.spacing_mm)
        right, down = (np.roll(moved, -1, axis) - moved for axis in (-1, -2))
        up = (moved[1:] - moved[:-1]) / self._thick[:, None, None, None]
        pairs = list(np.ndindex(2, 2))
        return [
            {(j, k): _across(_upwards(right / h, k), -2, j) for j, k in pairs},
            {(i, k): _across(_upwards(down / h, k), -1, i) for i, k in pairs},
            {(i, j): _across(_across(up, -1, i), -2, j) for i, j in pairs},
        ]

    def _stress(
        self, slopes: list[np.ndarray], pressure: np.ndarray
    ) -> tuple[list[np.ndarray], Float32[np.ndarray, 'rows y x']]:
        """Columns of the first Piola-Kirchhoff stress, and the volume ratio, from the derivatives along x, y and z."""
        one = np.float32(1)
        (a, d, g), (b, e, h), (c, f, i) = ((each[:, 0], each[:, 1], each[:, 2]) for each in slopes)
        a, e, i = a + one, e + one, i + one
        first = e * i - f * h, f * g - d * i, d * h - e * g  # cofactors of a, b, c (the row of x)
        second = c * h - b * i, a * i - c * g, b * g - a * h
        third = b * f - c * e, c * d - a * f, a * e - b * d
        ratio = a * first[0] + b * first[1] + c * first[2]
        push = pressure - one / np.maximum(ratio, np.float32(LEAST_VOLUME))
        rows = ((a, b, c), first), ((d, e, f), second), ((g, h, i), third)
        stress = [np.stack([row[k] + push * cofactor[k] for row, cofactor in rows], 1) for k in range(3)]
        return stress, ratio

    def _on_nodes(self, sums: list[dict[tuple[int, int], np.ndarray]]) -> Float32[np.ndarray, 'nodes 3 y x']:
        """Forces on nodes from stresses at integration points: the transpose of `_slopes`."""
        h = np.float32(self.layer.spacing_mm)
        weight = (self._volume / 8)[:, None]
        shape = (self.layer.rows + 1, 3, self.layer.cells, self.layer.cells)
        right, down = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        up: np.ndarray = np.zeros((self.layer.rows, *shape[1:]), np.float32)
        for one, two in np.ndindex(2, 2):
            _add_upwards(right, _back(weight * sums[0][one, two], -2, one), two)
            _add_upwards(down, _back(weight * sums[1][one, two], -1, one), two)
            up += _back(_back(weight * sums[2][one, two], -1, one), -2, two)
        force: np.ndarray = (np.roll(right, 1, -1) - right) / h + (np.roll(down, 1, -2) - down) / h
        up /= self._thick[:, None, None, None]
        force[:-1] -= up
        force[1:] += up
        return force

    def answer(
        self, force: Float32[np.ndarray, 'rows 3 y x'], lacking: Float32[np.ndarray, 'rows y x']
    ) -> tuple[Float32[np.ndarray, 'rows 3 y x'], Float32[np.ndarray, 'rows y x']]:
        """Displacements and pressures with which the layer at rest balances forces on its nodes and lacking volumes."""
        return self.from_spectrum(self.spectrum(force, lacking))

    def spectrum(self, force: np.ndarray, lacking: np.ndarray) -> Complex64[np.ndarray, 'unknowns waves']:
        """Transforms of loads for `from_spectrum`; each row is one axis of a node, or a brick."""
        cells = self.layer.cells
        both = np.concatenate([force.reshape(-1, cells, cells), lacking])
        waves: np.ndarray = scipy.fft.rfft2(both).reshape(len(both), -1).astype(np.complex64)
        return waves

    def from_spectrum(
        self, waves: Complex64[np.ndarray, 'unknowns waves']
    ) -> tuple[Float32[np.ndarray, 'rows 3 y x'], Float32[np.ndarray, 'rows y x']]:
        """The response to loads whose transforms are given."""
        cells, rows = self.layer.cells, self.layer.rows
        solved = np.matmul(self.inverse, waves.T[:, :, None])[:, :, 0].T
        both = scipy.fft.irfft2(solved.reshape(4 * rows, cells, -1), s=(cells, cells)).astype(np.float32)
        return both[: 3 * rows].reshape(rows, 3, cells, cells), both[3 * rows :]

    @property
    def surface(self) -> slice:
        """Rows of a spectrum that are the surface's three axes."""
        return slice(3 * self.layer.rows - 3, 3 * self.layer.rows)

    @cached_property
    def inverse(self) -> Complex64[np.ndarray, 'waves unknowns unknowns']:
        """Inverse of the linear layer for each pair of wave numbers: the nodes' axes from below, then the bricks."""
        cells, rows = self.layer.cells, self.layer.rows
        x, y = np.meshgrid(2 * np.pi * np.fft.rfftfreq(cells), 2 * np.pi * np.fft.fftfreq(cells))
        phase = np.exp(1j * np.stack([a * x + b * y for a in (0, 1) for b in (0, 1)])).reshape(4, -1)
        matrix = np.zeros((phase.shape[1], 4 * rows, 4 * rows), np.complex128)
        for row in range(rows):
            stiff, coupling = self._brick(row)
            stiff = np.einsum('am,azibyj,bm->mziyj', phase.conj(), stiff, phase, optimize=True).reshape(-1, 6, 6)
            coupling = np.einsum('am,azi->mzi', phase.conj(), coupling).reshape(-1, 6)
            at, own = np.arange(max(3 * row - 3, 0), 3 * row + 3), slice(0 if row else 3, 6)
            matrix[:, at[:, None], at] += stiff[:, own, own]
            matrix[:, at, 3 * rows + row] += coupling[:, own]
            matrix[:, 3 * rows + row, at] += coupling[:, own].conj()
            matrix[:, 3 * rows + row, 3 * rows + row] -= float(self._volume[row, 0, 0]) / self.layer.volume_stiffness
        inverse: np.ndarray = np.linalg.inv(matrix).astype(np.complex64)
        return inverse

    def _brick(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness and coupling to the pressure of one brick at rest, (corner, height, axis), corners x before y."""
        h, thick = self.layer.spacing_mm, float(self._thick[row])
        stiff, coupling, slope = np.zeros((2, 2, 2, 3, 2, 2, 2, 3)), np.zeros((2, 2, 2, 3)), np.array([-1.0, 1.0])
        for i, j, k in np.ndindex(2, 2, 2):
            along = np.stack(
                [
                    np.einsum('a,b,c->abc', slope, SHARES[j], SHARES[k]) / h,
                    np.einsum('a,b,c->abc', SHARES[i], slope, SHARES[k]) / h,
                    np.einsum('a,b,c->abc', SHARES[i], SHARES[j], slope) / thick,
                ],
                -1,
            )
            even = np.einsum('abck,defk,ij->abcidefj', along, along, np.eye(3))
            stiff += even + np.einsum('abcj,defi->abcidefj', along, along)
            coupling += along
        share = h * h * thick / 8
        return share * stiff.reshape(4, 2, 3, 4, 2, 3), share * coupling.reshape(4, 2, 3)


def _across(values: np.ndarray, axis: int, point: int) -> np.ndarray:
    """Interpolate between each node and the next, at an integration point."""
    near, far = SHARES[point].astype(np.float32)
    blended: np.ndarray = near * values + far * np.roll(values, -1, axis)
    return blended


def _back(values: np.ndarray, axis: int, point: int) -> np.ndarray:
    """The transpose of `_across`."""
    near, far = SHARES[point].astype(np.float32)
    gathered: np.ndarray = near * values + far * np.roll(values, 1, axis)
    return gathered


def _upwards(values: np.ndarray, point: int) -> np.ndarray:
    below, above = SHARES[point].astype(np.float32)
    blended: np.ndarray = below * values[:-1] + above * values[1:]
    return blended


def _add_upwards(nodes: np.ndarray, values: np.ndarray, point: int) -> None:
    below, above = SHARES[point].astype(np.float32)
    nodes[:-1] += below * values
    nodes[1:] += above * values
