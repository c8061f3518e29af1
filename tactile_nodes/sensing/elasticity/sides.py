"""What the sides of a gel change in its displacements: they are free, or held by a frame.

The layer of `layer` has no sides. 2 mm from the side of a gel 6 mm thick they change the motion that regions see by
more than a third (`pytest test/sensing/elasticity/test_sides.py`, which also compares with theory). The difference is
smooth, so coarse finite elements suffice: the same loads on a block with the sides of the gel, and on one that goes on
beyond them. The errors of the elements at the load are the same in both and cancel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactile_nodes.sensing.elasticity.block import Block, Lines
from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.elasticity.stack import Elastic
from tactile_nodes.shapes import Float, Float32, Int

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

FINEST, COARSEST, GROWTH = 1 / 8, 1 / 4, 1.25
"""Lengths of the elements over the thickness of the gel: at its sides, and at most; growth from one to the next."""

FEWEST = 24
"""The elements of a thin gel become longer, up to its length over this: far from its sides they do not matter."""

DOWN = 8
"""Elements through the thickness of the gel; at least one for each layer."""

BEYOND, BEYOND_GROWTH = 4.0, 1.6
"""How far the second block goes on beyond the sides, over the thickness; growth of its elements there."""

SPREAD = 16
"""Points along each side of a patch at which its load acts."""

BATCH = 36
"""Patches that are solved together."""


class BlockPair:
    """A gel of `layers` from the surface down as a block with its sides, and as one that goes on beyond them.

    `finer` divides the size of the elements. `lines_mm` are those of the first block.
    """

    def __init__(
        self, layers: Sequence[Elastic], size_mm: tuple[float, float], *, held: bool, finer: float = 1.0
    ) -> None:
        thick_mm = sum(each.thickness_mm for each in layers)
        down, material = _down(layers, round(DOWN * finer) / thick_mm)
        x, y = (_across(side, thick_mm / finer) for side in size_mm)
        beyond = _beyond(thick_mm, thick_mm / finer)
        modulus = np.array([each.shear_modulus_mpa for each in material])
        ratio = np.array([each.poisson_ratio for each in material])
        self.lines_mm: Lines = x, y, down
        wide_x, wide_y = (np.concatenate([each[0] - beyond[::-1], each, each[-1] + beyond]) for each in (x, y))
        self._within = cache(lambda: Block(self.lines_mm, modulus, ratio, held=held))
        self._wide = cache(lambda: Block((wide_x, wide_y, down), modulus, ratio))
        self._inner = (slice(len(beyond), -len(beyond)),) * 2

    def added_mm(self, loads_n: Float[np.ndarray, 'unknowns loads']) -> Float[np.ndarray, 'unknowns loads']:
        """The displacements that the sides add, under forces on the nodes of the first block."""
        added: np.ndarray = self.within_mm(loads_n) - self.without_mm(loads_n)
        return added

    def within_mm(self, loads_n: Float[np.ndarray, 'unknowns loads']) -> Float[np.ndarray, 'unknowns loads']:
        """The displacements of the block with sides."""
        moved: np.ndarray = self._within().moved_mm(loads_n)
        return moved

    def without_mm(self, loads_n: Float[np.ndarray, 'unknowns loads']) -> Float[np.ndarray, 'unknowns loads']:
        """The displacements of the same nodes if the block goes on beyond its sides."""
        there = np.zeros((*self._wide().shape, 3, loads_n.shape[1]))
        there[self._inner] = loads_n.reshape(*map(len, self.lines_mm), 3, -1)
        moved: np.ndarray = self._wide().moved_mm(there.reshape(-1, loads_n.shape[1])).reshape(there.shape)
        return moved[self._inner].reshape(loads_n.shape)

    def loads_n(
        self, place_mm: Float[np.ndarray, 'points 2'], force_n: Float[np.ndarray, 'points 3 loads']
    ) -> Float[np.ndarray, 'unknowns loads']:
        """Forces at points of the surface (x, y, out of the gel) as forces on the nodes."""
        x, y = (hats(place_mm[:, axis], self.lines_mm[axis]) for axis in (0, 1))
        loads = np.zeros((*map(len, self.lines_mm), 3, force_n.shape[-1]))
        loads[:, :, -1] = np.einsum('pi,pj,pal->ijal', x, y, force_n, optimize=True)
        return loads.reshape(-1, force_n.shape[-1])


@dataclass(frozen=True)
class Sides:
    """The displacements [mm] that sides add at the nodes of `lines_mm`, under 1 N on each patch.

    `added_mm` has the unknowns in the order of `Block`, and loads as (into the gel, along x or along y; patch).
    """

    lines_mm: Lines
    patches: PatchGrid
    added_mm: Float32[np.ndarray, 'unknowns loads']

    @property
    def pressed_mm(self) -> Float32[np.ndarray, 'unknowns patches']:
        """The same under forces into the gel alone."""
        return self.added_mm[:, : self.patches.count]

    def on_patches(
        self, place_mm: Float[np.ndarray, 'points 2'], force_n: Float[np.ndarray, ' points']
    ) -> Float[np.ndarray, ' patches']:
        """Forces at points as forces on the patches around them (linear between their middles)."""
        x, y = (hats(place_mm[:, axis], line) for axis, line in enumerate(self.patches.lines_mm))
        return np.asarray(np.einsum('px,py,p->yx', x, y, force_n, optimize=True).reshape(-1))


@lru_cache(maxsize=2)
def sides_of(layers: tuple[Elastic, ...], size_mm: tuple[float, float], patches: PatchGrid, *, held: bool) -> Sides:
    """The sides of a rectangular gel. They take some seconds to solve, and the last ones are kept."""
    pair = BlockPair(layers, size_mm, held=held)
    nodes = *(len(each) for each in pair.lines_mm), 3
    added = np.zeros((*nodes, 3, *patches.shape), np.float32)
    for some, without_mm in zip(_solved(patches), _without_sides(layers, size_mm, patches), strict=True):
        found = pair.within_mm(_on_patches(pair, patches, some)) - without_mm
        added[..., some // patches.shape[1], some % patches.shape[1]] = found.reshape(*nodes, 3, len(some))
    for axis, solved in enumerate(_quarter(patches)[::-1]):
        _mirror(np.moveaxis(added, -1 - axis, 0), axis, solved)
    return Sides(pair.lines_mm, patches, added.reshape(-1, 3 * patches.count))


@lru_cache(maxsize=1)
def _without_sides(
    layers: tuple[Elastic, ...], size_mm: tuple[float, float], patches: PatchGrid
) -> list[Float32[np.ndarray, 'unknowns loads']]:
    """The displacements without sides under 1 N on each patch: the same beside free and held sides."""
    pair = BlockPair(layers, size_mm, held=False)
    return [pair.without_mm(_on_patches(pair, patches, some)).astype(np.float32) for some in _solved(patches)]


def _solved(patches: PatchGrid) -> list[Int[np.ndarray, ' some']]:
    """The patches that are solved, in batches."""
    rows, cols = _quarter(patches)
    numbers = np.arange(patches.count).reshape(patches.shape)[:rows, :cols].ravel()
    return np.array_split(numbers, math.ceil(len(numbers) / BATCH))


def _quarter(patches: PatchGrid) -> tuple[int, int]:
    """Rows and columns of patches of which all others are mirror images; all if the bins are not in the middle."""
    rows, cols = patches.shape
    return (rows, cols) if any(patches.bins.centre_mm) else ((rows + 1) // 2, (cols + 1) // 2)


def _on_patches(
    pair: BlockPair, patches: PatchGrid, numbers: Int[np.ndarray, ' some']
) -> Float[np.ndarray, 'unknowns loads']:
    """Forces on the nodes under 1 N on some patches: into the gel on each, then along x, then along y."""
    within = (np.arange(SPREAD) + 0.5) / SPREAD - 0.5
    width, height = patches.size_mm
    spread = np.stack(np.meshgrid(width * within, height * within), -1).reshape(-1, 2)
    force = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T / len(spread)
    loads = [pair.loads_n(each + spread, np.tile(force, (len(spread), 1, 1))) for each in patches.centres_mm[numbers]]
    return np.stack(loads, -1).reshape(len(loads[0]), -1)


def _mirror(added: Float32[np.ndarray, 'line x y z axis load other'], axis: int, solved: int) -> None:
    """Fill in what follows from the first `solved` lines of patches along an axis by mirroring that axis."""
    count = len(added)
    for line in range(solved, count):
        added[line] = np.flip(added[count - 1 - line], axis)
        added[line, :, :, :, axis] *= -1
        added[line, :, :, :, :, 1 + axis] *= -1


def _down(layers: Sequence[Elastic], per_mm: float) -> tuple[Float[np.ndarray, ' z'], list[Elastic]]:
    """Heights of the elements' borders from the base to the surface at 0, and the material of each interval."""
    steps, material = list[float](), list[Elastic]()
    for layer in reversed(layers):
        count = max(1, round(per_mm * layer.thickness_mm))
        steps += [layer.thickness_mm / count] * count
        material += [layer] * count
    return np.concatenate([np.cumsum([0.0, *steps[:-1]]) - sum(steps), [0.0]]), material


def _across(side_mm: float, thick_mm: float) -> Float[np.ndarray, ' lines']:
    """Borders of the elements along a side, symmetric, finest at both ends."""
    steps, step = list[float](), FINEST * thick_mm
    while sum(steps) < side_mm / 2:
        steps.append(step)
        step = min(step * GROWTH, max(COARSEST * thick_mm, side_mm / FEWEST))
    half = np.cumsum([0.0, *steps]) * side_mm / 2 / sum(steps) - side_mm / 2
    return np.concatenate([half[:-1], [0.0], -half[-2::-1]])


def _beyond(thick_mm: float, fine_mm: float) -> Float[np.ndarray, ' lines']:
    """Borders of the elements beyond a side, from it."""
    steps = [FINEST * fine_mm]
    while sum(steps) < BEYOND * thick_mm:
        steps.append(steps[-1] * BEYOND_GROWTH)
    return np.cumsum(steps)


def hats(at: Float[np.ndarray, ' n'], lines: Float[np.ndarray, ' lines']) -> Float[np.ndarray, 'n lines']:
    """Weights of the lines beside each place, for linear interpolation; places outside count as at the end."""
    low, part = _cell(at, lines)
    weights = np.zeros((len(at), len(lines)))
    rows = np.arange(len(at))
    weights[rows, low], weights[rows, low + 1] = 1 - part, part
    return weights


def _cell(at: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The line below each place, and the share of the way to the next."""
    inside = np.clip(at, lines[0], lines[-1])
    low = np.clip(np.searchsorted(lines, inside, side='right') - 1, 0, len(lines) - 2)
    return low, (inside - lines[low]) / (lines[low + 1] - lines[low])


def seen(
    lines_mm: Lines, points_mm: Float[np.ndarray, 'parts points 3'], levers: Float[np.ndarray, 'parts points rows 3']
) -> csr_matrix:
    """The matrix from displacements of nodes to those of points, times levers, summed over the points of a part.

    Its rows are (part, row of the levers): with levers in px per mm the motion of the parts in the image.
    """
    from scipy.sparse import csr_matrix

    parts, points, rows, _ = levers.shape
    weight, node = np.ones((parts, points, 1)), np.zeros((parts, points, 1), int)
    for axis, line in enumerate(lines_mm):
        low, part = _cell(points_mm[..., axis], line)
        weight = (weight[..., None] * np.stack([1 - part, part], -1)[:, :, None]).reshape(parts, points, -1)
        node = (node[..., None] * len(line) + np.stack([low, low + 1], -1)[:, :, None]).reshape(parts, points, -1)
    values = np.einsum('prn,prda->pdrna', weight, levers).reshape(rows * parts, -1).astype(np.float32)
    unknown = np.broadcast_to((3 * node[..., None] + np.arange(3))[:, None], (parts, rows, *node.shape[1:], 3))
    ends = np.arange(0, values.size + 1, values.shape[1])
    count = 3 * int(np.prod([len(line) for line in lines_mm]))
    return csr_matrix((values.ravel(), unknown.reshape(-1), ends), (rows * parts, count))
