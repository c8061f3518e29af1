"""Fits the network of a refinement in torch, by solved fields of simulated touches and their true forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes.learning.network.layers import import_torch
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.elasticity.patches import PER_BIN
from tactile_nodes.sensing.explain.field.refinement import (
    CHANGE,
    FORCE_TIMES,
    GROWN,
    INPUTS,
    KEPT,
    LEAST_SPREAD,
    MARGIN,
    SOLVED,
    VECTORS,
    Refinement,
)
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.shapes import Float32

if TYPE_CHECKING:
    import torch

HIDDEN = 16, 16, 16
EPOCHS, BATCH = 80, 64
STEEPEST, DECAY, LARGEST_GRADIENT = 5e-3, 3e-2, 1.0
"""Highest rate of the one-cycle schedule (Smith 2018), decay of the weights (AdamW), and greatest norm of the gradient:
one that is far too large could leave no force anywhere, from which the network does not recover."""

FIRST_CHANGE = 0.02
"""Factor on the last layer's initial weights: at first nothing changes."""

SQUARED, SHEARED, FINE, TOTAL = 2.0, 0.3, 1.0, 0.3
"""Weights of the squared error of bins, of the error of their shear, of the squared error of patches, and of the
relative error of the total, beside the misplaced share of the force."""

USUAL = 0.05, 0.95
"""Quantiles of the totals in training, as multiples of the solved ones, beyond which no total is changed: what has not
been seen must not double a force."""

LIGHT_N, HARD_N = 0.1, 3.0
"""Squared errors count by the total force, from this one to that one."""


@dataclass(frozen=True)
class Samples:
    """Inputs of the network, the solved forces and the true ones, as shares of the solved and true total normal force.

    `total_n` is the true total [N], and `solved_n` the solved one.
    """

    inputs: Float32[np.ndarray, 'n inputs h w']
    solved: Float32[np.ndarray, 'n 3 h w']
    true: Float32[np.ndarray, 'n 3 h w']
    total_n: Float32[np.ndarray, ' n']
    solved_n: Float32[np.ndarray, ' n']

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Samples:
        """All samples of some parts."""
        names = 'inputs', 'solved', 'true', 'total_n', 'solved_n'
        return cls(*(np.concatenate([getattr(each, name) for each in parts]) for name in names))


def misplaced(shares: Float32[np.ndarray, 'n 3 h w'], true: Float32[np.ndarray, 'n 3 h w']) -> float:
    """Mean share of the normal force that is in the wrong bins, whatever its total."""
    told = shares[:, 0].sum(axis=(1, 2), keepdims=True)
    off = _over_bins(shares[:, 0] / told) - _over_bins(true[:, 0])
    return float(np.abs(off).sum(axis=(1, 2)).mean() / 2)


def totals_off(shares: Float32[np.ndarray, 'n 3 h w'], samples: Samples) -> float:
    """Median relative error of the total, of forces that are shares of the solved one."""
    told_n = shares[:, 0].sum(axis=(1, 2)) * samples.solved_n
    return float(np.median(np.abs(told_n / samples.total_n - 1)))


def _over_bins(values: Any) -> Any:
    """Sums over the patches of each bin, of an array or a tensor."""
    *others, rows, cols = values.shape
    return values.reshape(*others, rows // PER_BIN, PER_BIN, cols // PER_BIN, PER_BIN).sum((-3, -1))


def fit_refinement(samples: Samples, seed: int, progress: Progress, *, keeps_total: bool = True) -> Refinement:
    """The network that brings solved forces closest to the true ones.

    Unless `keeps_total`, it may change the total and its centre.

    Each batch is turned by quarters and mirrored at random: no direction differs from another.

    Raises:
        ConfigurationError: torch is not installed.
    """
    torch = import_torch()
    torch.manual_seed(seed)
    random, count = np.random.default_rng(seed), len(samples.inputs)
    layers = _layers()
    parameters = [each for layer in layers for each in layer.parameters()]
    optimizer = torch.optim.AdamW(parameters, weight_decay=DECAY)
    steps = EPOCHS * -(-count // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, STEEPEST, steps)
    inputs, solved, true = (torch.from_numpy(each) for each in (samples.inputs, samples.solved, samples.true))
    weights = torch.from_numpy(np.clip(samples.total_n, LIGHT_N, HARD_N))
    missing = torch.from_numpy(np.log(samples.total_n / samples.solved_n))
    with progress.bar('fitting the refinement', EPOCHS) as bar:
        for _ in range(EPOCHS):
            for rows in np.array_split(random.permutation(count), -(-count // BATCH)):
                quarters, mirrored = int(random.integers(4)), bool(random.integers(2))
                seen, field, wanted = (
                    _turned(each[rows], vectors, quarters, mirrored=mirrored)
                    for each, vectors in ((inputs, VECTORS), (solved, ((1, 2),)), (true, ((1, 2),)))
                )
                refined, total = _refined(layers, seen, field, keeps_total=keeps_total)
                loss = _loss(refined, wanted, weights[rows]) + TOTAL * (total.log() - missing[rows]).abs().mean()
                optimizer.zero_grad()
                torch.autograd.backward(loss)
                torch.nn.utils.clip_grad_norm_(parameters, LARGEST_GRADIENT)
                optimizer.step()
                schedule.step()
            bar.advance()
    kernels, biases = zip(
        *([part.detach().numpy().copy() for part in each.parameters()] for each in layers), strict=True
    )
    told = np.quantile(samples.total_n / samples.solved_n, USUAL).tolist()
    return Refinement(kernels, biases, KEPT if keeps_total else (told[0], told[1]))


def _layers() -> list[torch.nn.Conv2d]:
    import torch

    sizes = INPUTS, *HIDDEN, 3
    layers = [torch.nn.Conv2d(before, after, 3, padding=1) for before, after in pairwise(sizes)]
    with torch.no_grad():
        for part, factor in zip(layers[-1].parameters(), (FIRST_CHANGE, 0.0), strict=True):
            part.mul_(factor)
    return layers


def _refined(
    layers: Sequence[torch.nn.Conv2d], inputs: torch.Tensor, solved: torch.Tensor, *, keeps_total: bool
) -> tuple[torch.Tensor, torch.Tensor]:
    """As `Refinement.refined`, for shares of the total force; and the new total as a multiple of the solved one."""
    import torch

    active = inputs[:, SOLVED : SOLVED + 1]
    box = _around(active, 2) * _around(active, 3)
    values = inputs * box
    for layer in layers[:-1]:
        values = torch.relu(layer(values)) * box
    grown = torch.nn.functional.max_pool2d(active, 2 * GROWN + 1, 1, GROWN)
    changed = (solved + CHANGE * layers[-1](values)) * grown
    return _kept(changed, solved, total=keeps_total)


def _kept(changed: torch.Tensor, before: torch.Tensor, *, total: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """As in `sensing.explain.field.refinement`, but as shares of the new total; and that total.

    It has no limits here, beyond which the gradient would be zero.
    """
    import torch

    rows, cols = changed.shape[2:]
    lines = torch.meshgrid(torch.arange(rows).float(), torch.arange(cols).float(), indexing='ij')
    place = torch.stack([lines[1], lines[0]])[None]
    pressed = torch.relu(changed[:, :1])
    normal, times = _of_one(pressed), torch.ones(len(changed), 1, 1, 1)
    if total:
        centre = (before[:, :1] * place).sum((2, 3), keepdim=True)
        normal = _centred(normal, centre, place)
    else:
        centre = (normal * place).sum((2, 3), keepdim=True)
        times = pressed.sum((2, 3), keepdim=True).clamp_min(1e-6)
    shear = changed[:, 1:] / times
    shear = shear * torch.clamp(normal / shear.norm(dim=1, keepdim=True).clamp_min(1e-9), max=1.0)
    across = torch.stack([centre[:, 1] - place[:, 1], place[:, 0] - centre[:, 0]], 1)
    missing = before[:, 1:] / times - shear
    wide = (across.square().sum(1, keepdim=True) * normal).sum((2, 3), keepdim=True).clamp_min(LEAST_SPREAD)
    turned = (across * missing).sum((1, 2, 3), keepdim=True) / wide
    shear = shear + normal * (missing.sum((2, 3), keepdim=True) + turned * across)
    return torch.cat([normal, shear], 1), times[:, 0, 0, 0]


def _centred(normal: torch.Tensor, centre: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    import torch

    middle = (normal * place).sum((2, 3), keepdim=True)
    away = place - middle
    spread = torch.einsum('nihw,njhw,nhw->nij', away, away, normal[:, 0]) + LEAST_SPREAD * torch.eye(2)
    plane = torch.linalg.solve(spread, (centre - middle)[..., 0])
    normal = _of_one(normal * torch.relu(1 + (plane[..., None] * away).sum(1, keepdim=True)))
    return _of_one(_shifted(normal, (centre - (normal * place).sum((2, 3), keepdim=True))[:, :, 0, 0]))


def _shifted(normal: torch.Tensor, by: torch.Tensor) -> torch.Tensor:
    """Forces moved by up to one patch along x and y: shared between neighbours."""
    import torch

    shares = torch.stack([torch.relu(by), 1 - by.abs(), torch.relu(-by)], -1).clamp(0, 1)
    kernels = shares[:, 1, :, None] * shares[:, 0, None, :]
    moved: torch.Tensor = torch.conv2d(normal.transpose(0, 1), kernels[:, None], padding=1, groups=len(normal))
    return moved.transpose(0, 1)


def _of_one(normal: torch.Tensor) -> torch.Tensor:
    """Forces with the sum 1."""
    return normal / normal.sum((2, 3), keepdim=True).clamp_min(1e-6)


def _around(active: torch.Tensor, along: int) -> torch.Tensor:
    """1 on the lines along an axis from the first to the last active one, and on a margin."""
    import torch

    there = active.amax(5 - along, keepdim=True)
    count = there.shape[along]
    number = torch.arange(count).view([-1 if axis == along else 1 for axis in range(4)])
    first = torch.where(there > 0, number, count).amin(along, keepdim=True) - MARGIN
    last = torch.where(there > 0, number, -1).amax(along, keepdim=True) + MARGIN
    return ((number >= first) & (number <= last)).float()


def _loss(refined: torch.Tensor, true: torch.Tensor, total_n: torch.Tensor) -> torch.Tensor:
    off = _over_bins(refined) - _over_bins(true)
    wrong = off[:, 0].abs().sum((1, 2)) / 2
    squared = total_n * off[:, 0].square().sum((1, 2))
    sheared = (off[:, 1:].square().sum((1, 2, 3)) + 1e-12).sqrt()
    fine = (refined - true).square().sum((1, 2, 3))
    loss: torch.Tensor = (wrong + SQUARED * squared + SHEARED * sheared + FINE * fine).mean()
    return loss


def _turned(values: torch.Tensor, vectors: Sequence[tuple[int, int]], quarters: int, *, mirrored: bool) -> torch.Tensor:
    """Maps mirrored along x and turned by quarters, with their vectors."""
    import torch

    if mirrored:
        values = torch.flip(values, [3])
        for x, _ in vectors:
            values[:, x] = -values[:, x]
    for _ in range(quarters):  # x to the right becomes -y
        values = torch.rot90(values, 1, [2, 3]).clone()
        for x, y in vectors:
            along_x, along_y = values[:, x].clone(), values[:, y].clone()
            values[:, x], values[:, y] = along_y, -along_x
    return values


def shares_of(refinement: Refinement, inputs: Float32[np.ndarray, 'inputs h w']) -> Float32[np.ndarray, '3 h w']:
    """The refined forces as shares of the solved total normal force."""
    forces = inputs[:3].reshape(3, -1) / FORCE_TIMES
    found = Field(forces.astype(float), np.flatnonzero(inputs[SOLVED]), np.zeros((0, 0)), 0.0, 0.0)
    refined: np.ndarray = refinement.refined(found, inputs).forces_n.reshape(3, *inputs.shape[1:])
    return refined
