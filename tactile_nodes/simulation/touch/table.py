"""Lookup table of a solved track: motion of markers and forces, at any place and stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes.shapes import Float, Float32

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

    from tactile_nodes.simulation.touch.track import Track

from tactile_nodes.sensing.geometry import BinGrid

SPACING_MM, ROW_MM = 0.625, 0.75
"""Steps of the table, sideways and down, for markers from 1.5 mm below the surface on: no motion changes faster there.
For markers nearer to the surface the steps are smaller in proportion, down to those of the track itself."""

FINEST_MM, FINEST_ROW_MM = 0.4, 0.15

REACH_MM = 20.0
"""Extent of the table from its middle; further away the motion is that at the rim, almost zero."""


def table_steps_mm(highest_mm: float) -> tuple[float, float]:
    """Steps of a table (sideways, down) for points up to `highest_mm`: 0.625 and 0.75 below -1.5 mm."""
    nearer = min(-highest_mm / 1.5, 1.0)
    return max(SPACING_MM * nearer, FINEST_MM), max(ROW_MM * nearer, FINEST_ROW_MM)


@dataclass(frozen=True)
class Touch:
    """A body over a place on the surface, turned about z, at a stage of its path; up to stage 0 it is above the gel."""

    body: str
    x_mm: float
    y_mm: float
    turn_rad: float = 0.0
    stage: float = 0.0

    @property
    def touching(self) -> bool:
        return self.stage > 0


@dataclass(frozen=True)
class TouchTable:
    """Coefficients of cubic B-splines on a regular grid, stage by stage, and forces on points of the surface.

    Forces are over the shear modulus, x and y along the surface, z into the gel.
    """

    coefficients: Float32[np.ndarray, 'stages z 3 y x']
    spacing_mm: float
    lowest_mm: float
    row_mm: float
    depth_mm: Float[np.ndarray, ' stages']
    shift_mm: Float[np.ndarray, 'stages 2']
    turn_rad: Float[np.ndarray, ' stages']
    node_mm: Float32[np.ndarray, 'nodes 2']
    node_force: Float32[np.ndarray, 'stages nodes 3']
    node_size_mm: float
    key: str

    @classmethod
    def of_track(cls, track: Track, highest_mm: float) -> TouchTable:
        """The table for points up to `highest_mm`: the markers under the skin."""
        from scipy.interpolate import CubicSpline  # imported here and below: looking up needs no SciPy
        from scipy.ndimage import spline_filter

        spacing_mm, row_mm = table_steps_mm(highest_mm)
        top_mm = min(0.0, highest_mm + 2 * row_mm)  # splines are less accurate near the rim of a table
        z_mm = np.linspace(track.z_mm[0], top_mm, max(4, round((top_mm - track.z_mm[0]) / row_mm) + 1))
        moved = CubicSpline(track.z_mm, track.moved_mm, axis=1)(z_mm)
        width = len(track.line_mm) * (track.line_mm[1] - track.line_mm[0])
        cells = 2 * round(width / spacing_mm / 2)
        moved = _resampled(moved, cells)
        half = min(cells // 2 - 1, int(REACH_MM * cells / width))
        keep = slice(cells // 2 - half, cells // 2 + half + 1)  # the middle of the body is the middle of the table
        moved = moved[..., keep, keep]
        for stage, axis in np.ndindex(len(moved), 3):
            moved[stage, :, axis] = spline_filter(moved[stage, :, axis], order=3, mode='mirror')
        return cls(
            moved.astype(np.float32), width / cells, float(z_mm[0]), float(z_mm[1] - z_mm[0]), track.depth_mm,
            track.shift_mm, track.turn_rad, track.node_mm, track.node_force * np.array([1, 1, -1], np.float32),
            float(track.line_mm[1] - track.line_mm[0]), track.key,
        )  # fmt: skip

    def to_arrays(self) -> dict[str, np.ndarray]:
        """As plain arrays, for a file; displacements as 16-bit floats."""
        arrays = {each.name: np.asarray(getattr(self, each.name)) for each in fields(self)}
        return {**arrays, 'coefficients': self.coefficients.astype(np.float16)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> TouchTable:
        """The table from plain arrays.

        Raises:
            KeyError, TypeError, ValueError: these are not the arrays of a table.
        """
        numbers = 'spacing_mm', 'lowest_mm', 'row_mm', 'node_size_mm'
        values: dict[str, Any] = {each.name: arrays[each.name] for each in fields(cls)}
        values |= {name: float(arrays[name]) for name in numbers}
        return cls(**{**values, 'coefficients': arrays['coefficients'].astype(np.float32), 'key': str(arrays['key'])})

    @property
    def stages(self) -> int:
        return len(self.coefficients)

    @property
    def force(self) -> Float[np.ndarray, 'stages 3']:
        """The whole force at each stage."""
        total: np.ndarray = self.node_force.sum(axis=1, dtype=float)
        return total

    @cached_property
    def node_moved_mm(self) -> Float32[np.ndarray, 'stages nodes 2']:
        """Displacement of the surface along x and y at each point on which forces act."""
        points = np.column_stack([self.node_mm, np.zeros(len(self.node_mm))]).astype(np.float32)
        placed = Placed(self, points, Touch('', 0.0, 0.0))
        return np.stack([placed.moved_mm(float(stage))[:, :2] for stage in range(self.stages)])

    @property
    def presses(self) -> int:
        """The last stage of the press, before it is dragged."""
        still = ~(np.abs(self.shift_mm).any(axis=1) | (self.turn_rad != 0))
        return int(np.flatnonzero(still)[-1])

    def between(self, values: np.ndarray, stage: float) -> np.ndarray:
        """Interpolate values given for every stage."""
        low = min(max(int(stage), 0), self.stages - 2)
        part = min(max(stage - low, 0.0), 1.0)
        blended: np.ndarray = (1 - part) * values[low] + part * values[low + 1]
        return blended


class Placed:
    """A table at a place: the weights of the coefficients for each marker, computed once while the body stays there."""

    def __init__(self, table: TouchTable, points_mm: Float32[np.ndarray, 'points 3'], touch: Touch) -> None:
        self._table, self._turn_rad = table, touch.turn_rad
        rows, _, side, _ = table.coefficients.shape[1:]
        away = _turned(points_mm[:, :2] - np.array([touch.x_mm, touch.y_mm], np.float32), -touch.turn_rad)
        at = np.clip(away / table.spacing_mm + (side - 1) / 2, 0, side - 1)
        up = np.clip((points_mm[:, 2] - table.lowest_mm) / table.row_mm, 0, rows - 1)
        self._weights = _weights((up, at[:, 1], at[:, 0]), (rows, side, side))

    def moved_mm(self, stage: float) -> Float32[np.ndarray, 'points 3']:
        grid = self._table.between(self._table.coefficients, stage).transpose(0, 2, 3, 1).reshape(-1, 3)
        moved: np.ndarray = self._weights @ grid
        moved[:, :2] = _turned(moved[:, :2], self._turn_rad)
        return moved


def node_forces(
    table: TouchTable, touch: Touch, moved: float = 1.0
) -> tuple[Float[np.ndarray, 'nodes 2'], Float[np.ndarray, 'nodes 3']]:
    """Places where forces act now [mm], and these forces over the shear modulus: x, y, into the gel.

    With a share `moved` of 0, the places are those of the same points of the surface without contact.

    Forces move with a dragged body: those of a tip that stuck and was dragged by 0.5 mm act 0.5 mm from the place where
    it touched down.
    """
    force = table.between(table.node_force, touch.stage).astype(float)
    force[:, :2] = _turned(force[:, :2], touch.turn_rad)
    place = table.node_mm + moved * table.between(table.node_moved_mm, touch.stage)
    return _turned(place.astype(float), touch.turn_rad) + np.array([touch.x_mm, touch.y_mm]), force


def over_bins(
    place_mm: Float[np.ndarray, 'nodes 2'], force: Float[np.ndarray, 'nodes 3'], size_mm: float, bins: BinGrid
) -> Float[np.ndarray, 'rows cols 3']:
    """Forces summed over bins, each spread evenly over a square of `size_mm` about its place.

    Force outside the surface counts towards the outermost bins, so that the sum is kept. A square of 1 mm centred on
    the border between two bins gives each a half.
    """
    shares = []
    for axis, count, length in ((0, bins.cols, bins.width_mm), (1, bins.rows, bins.height_mm)):
        borders = bins.centre_mm[axis] + np.linspace(-length / 2, length / 2, count + 1)[1:-1]
        below = np.clip((borders - place_mm[:, axis, None]) / size_mm + 0.5, 0, 1)
        ends = np.zeros((len(place_mm), 1)), np.ones((len(place_mm), 1))
        shares.append(np.diff(np.concatenate([ends[0], below, ends[1]], axis=1), axis=1))
    summed: np.ndarray = np.einsum('nx,ny,nc->yxc', *shares, force, optimize=True)
    return summed


def _turned(vectors: np.ndarray, angle_rad: float) -> np.ndarray:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: np.ndarray = vectors @ np.array([[cos, sin], [-sin, cos]], vectors.dtype)
    return turned


def _resampled(values: np.ndarray, cells: int) -> np.ndarray:
    """A periodic grid resampled to fewer cells by truncating its transform; the middle cell keeps its place."""
    have = values.shape[-1]
    waves = np.fft.fft2(np.roll(values, (-(have // 2),) * 2, (-2, -1)))
    keep = np.r_[0 : cells // 2, have - cells + cells // 2 : have]
    fewer = np.fft.ifft2(waves[..., keep[:, None], keep]).real * (cells / have) ** 2
    return np.roll(fewer, (cells // 2,) * 2, (-2, -1))


def _weights(places: tuple[np.ndarray, np.ndarray, np.ndarray], shape: tuple[int, int, int]) -> csr_matrix:
    """Cubic B-splines at places of a grid, mirrored at its borders, as a matrix on all of its coefficients."""
    parts, indices = [], []
    for place, count in zip(places, shape, strict=True):
        first = np.floor(place).astype(np.int32)
        t = (place - first)[:, None]
        parts.append(np.concatenate([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * (t + t**2 - t**3), t**3], 1) / 6)
        index = np.abs(first[:, None] + np.arange(-1, 3, dtype=np.int32))
        indices.append(np.where(index > count - 1, 2 * (count - 1) - index, index))
    up, down, right = (each.astype(np.float32) for each in parts)
    plane = (down[:, :, None] * right[:, None]).reshape(-1, 1, 16)
    weight = (up[:, :, None] * plane).reshape(len(up), 64)
    z, y, x = indices
    index = (z[:, :, None, None] * shape[1] + y[:, None, :, None]) * shape[2] + x[:, None, None, :]
    rows = np.arange(0, weight.size + 1, 64, dtype=np.int32)
    from scipy.sparse import csr_matrix

    return csr_matrix((weight.ravel(), index.reshape(-1), rows), (len(weight), int(np.prod(shape))))
