"""What a drag adds to a response, from presses that a training made once more with one.

A dragged press less what the response makes of the same press straight down is what its drag adds: one picture of
each tells it. Presses that no fit saw say how smooth that is, what a press without a drag is taken for, and how far
off forces are with one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse
from jaxtyping import Float

from tactile_nodes.learning.config import ResponseConfig
from tactile_nodes.learning.coverage import COVERAGE, NORMAL_90, ONE_OF_A_THOUSAND
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.dragged_presses import DraggedPresses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.response_fit import Subspace, curvature, inner_held_out, sparse_cubes
from tactile_nodes.sensing.contact_drag import AMOUNTS, Drag, amounts, dragged, gained_by_drag
from tactile_nodes.sensing.response_readout import ResponseReadout
from tactile_nodes.sensing.splines import SplineAxis

SPACING_MM, LEVELS = 3.0, 2
"""A drag reaches as far as the contact is wide and no further than the layer is thick. With knots further apart
forces under a drag of half a millimetre are further off."""

SMOOTHING = (1e-4, 1e-3, 1e-2, 1e-1)
"""Weights of the penalty on curvature that are tried."""

PRESSES_PER_COMPONENT = 10
"""With fewer dragged presses their noise is larger than what they tell."""

LEAST_JUDGES = 200
MOST_JUDGES = 2000


def with_drag(
    readout: ResponseReadout,
    dataset: Dataset,
    presses: DraggedPresses | None,
    held_out: np.ndarray,
    config: ResponseConfig,
    progress: Progress,
) -> ResponseReadout:
    """The readout with what a drag adds; as it was where there are too few dragged presses to tell.

    Args:
        readout: what `fit_response` made of `dataset`.
        presses: its first samples, once more with a drag.
        held_out: which samples of `dataset` no fit sees.
    """
    if presses is None:
        return readout
    study = _Study.of(readout, presses, held_out)
    components = len(readout.whitening)
    if len(study.added) < PRESSES_PER_COMPONENT * components:
        progress.say(
            f'{len(study.added)} dragged presses are too few to tell what a drag does to {components} components'
        )
        return readout
    with progress.bar('measuring what a drag does', len(SMOOTHING) + 2) as bar:
        inner = inner_held_out(study.dataset, np.arange(len(study.added)), config.seed)
        early, tried = study.take(~inner), []
        for smoothing in SMOOTHING:
            coefficients = early.coefficients(smoothing)
            tried.append((study.take(inner).misfit(coefficients), smoothing, coefficients))
            bar.advance(1, f'smoothing {smoothing:g}: misfit {tried[-1][0]:.4g}')
        _, smoothing, coefficients = min(tried, key=lambda each: each[:2])
        drag = early.drag(coefficients, config.drag_mm)
        drag = replace(drag, least_gain=_least_gain(readout, drag, dataset, held_out))
        bar.advance(1, f'told from a gain of {drag.least_gain:.3g} on')
        doubt_n = study.take(inner).doubt_n(readout, drag)
        final = study.drag(study.coefficients(smoothing), config.drag_mm)
        bar.advance(1, f'off by {doubt_n:.3g} N per mm')
    return replace(readout, drag=replace(final, least_gain=drag.least_gain, doubt_n=doubt_n))


@dataclass(frozen=True)
class _Study:
    """Dragged presses: what is seen, and what of that the response to presses straight down does not make."""

    dataset: Dataset
    pull_mm: Float[np.ndarray, 'samples 2']
    seen: Float[np.ndarray, 'samples components']
    added: Float[np.ndarray, 'samples components']
    axes: tuple[SplineAxis, SplineAxis, SplineAxis]
    places: Float[np.ndarray, 'samples 3']

    @classmethod
    def of(cls, readout: ResponseReadout, presses: DraggedPresses, held_out: np.ndarray) -> _Study:
        subspace, response = Subspace.seen_by(readout, presses.dataset), readout.response
        seen = subspace.components @ readout.whitening.T.astype(float)
        used = subspace.touched & ~held_out[: len(seen)] & np.isfinite(seen).all(axis=1)
        places = subspace.places[used]
        straight = sparse_cubes(response.axes, places) @ response.coefficients.reshape(-1, seen.shape[1])
        x, y = (replace(axis, intervals=_intervals(axis)) for axis in response.axes[:2])
        return cls(
            presses.dataset.take(np.flatnonzero(used)), presses.pull_mm[used].astype(float), seen[used],
            seen[used] - straight, (x, y, replace(response.s, intervals=LEVELS)), places,
        )  # fmt: skip

    def take(self, which: np.ndarray) -> _Study:
        """Some of the presses."""
        numbers = np.flatnonzero(which)
        return replace(
            self, dataset=self.dataset.take(numbers), pull_mm=self.pull_mm[numbers], seen=self.seen[numbers],
            added=self.added[numbers], places=self.places[numbers],
        )  # fmt: skip

    @property
    def design(self) -> scipy.sparse.csr_array:
        """Splines over place and force, times each amount."""
        cubes = sparse_cubes(self.axes, self.places)
        parts = np.array([amounts(each) for each in self.pull_mm]).T
        return scipy.sparse.hstack([cubes.multiply(part[:, None]) for part in parts], format='csr')

    def coefficients(self, smoothing: float) -> Float[np.ndarray, 'n components']:
        """Least squares, smooth along each axis; those of one amount after those of the other."""
        design = self.design
        square = (design.T @ design).toarray() + smoothing * np.kron(np.eye(AMOUNTS), curvature(self.axes))
        square[np.diag_indices_from(square)] += 1e-9 * np.trace(square) / len(square)
        solved: np.ndarray = scipy.linalg.solve(square, design.T @ self.added, assume_a='pos', overwrite_a=True)
        return solved

    def misfit(self, coefficients: np.ndarray) -> float:
        """Root mean square of what coefficients leave over."""
        return float(np.sqrt(np.mean((self.added - self.design @ coefficients) ** 2)))

    def drag(self, coefficients: np.ndarray, most_mm: float) -> Drag:
        """As the readout takes it, with limits that tell every drag."""
        shape = (AMOUNTS, *(axis.count for axis in self.axes), coefficients.shape[1])
        table = np.moveaxis(coefficients.reshape(shape), 0, 3).astype(np.float16)
        return Drag(*self.axes, table, 0.0, most_mm, 0.0)

    def doubt_n(self, readout: ResponseReadout, drag: Drag) -> float:
        """What forces are off by for each mm, beside what is stated, such that 90 % of them lie within it."""
        lengths, forces_n = np.hypot(*self.pull_mm.T), self.dataset.presses[:, 3]
        more = []
        for seen, length_mm, force_n in zip(self.seen, lengths.tolist(), forces_n.tolist(), strict=True):
            told = readout.single(np.asarray(seen, np.float32))
            found = dragged(readout.response, drag, np.asarray(seen, np.float32), told)
            contact = readout.contacts(told if found is None else found.fit)[0]
            missed = ((contact.force_n - force_n) / NORMAL_90) ** 2 - contact.sigma_n**2
            more.append(max(missed, 0.0) ** 0.5 / length_mm)
        return float(np.percentile(more, 100 * COVERAGE))


def _intervals(axis: SplineAxis) -> int:
    return max(1, round((axis.high - axis.low) / SPACING_MM))


def _least_gain(readout: ResponseReadout, drag: Drag, dataset: Dataset, held_out: np.ndarray) -> float:
    """What no more than one of a thousand presses straight down gains by a drag."""
    touched = dataset.presses[:, 2] > 0
    judges = np.flatnonzero(touched & held_out)
    if len(judges) < LEAST_JUDGES:
        judges = np.flatnonzero(touched)
    judges = judges[:: max(1, -(-len(judges) // MOST_JUDGES))]
    subspace = Subspace.seen_by(readout, dataset.take(judges))
    seen = [np.asarray(readout.whitening @ each, np.float32) for each in subspace.components if np.isfinite(each).all()]
    gains = [gained_by_drag(readout.response, drag, each, readout.single(each)) for each in seen]
    return float(np.percentile(gains, ONE_OF_A_THOUSAND))
