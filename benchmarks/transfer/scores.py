"""Scores of a readout on presses, and their statistical errors.

The paper's aRMSE depends mostly on the few presses whose distance to a border between bins is smaller than the error of
their place: some eight of 1200 on the paper's grid. But the borders are not a property of the gel. So the aRMSE is also
computed as the mean over many placements of the same grid, where every press is sometimes close to a border.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float, Int

if TYPE_CHECKING:
    from tactile_nodes.learning.datasets.simulated import Dataset
    from tactile_nodes.sensing.explain.arrays import AnyReadout

COUNTS, PICTURES = (10, 25, 50, 100), 8
"""Numbers of presses for calibration, and pictures of each, as in config/calibrate.yaml."""
AS_IT_IS, MANY, CALIBRATED, ALONE = 'as it is', 'of many gels', 'calibrated', 'fitted alone'
TRAINED = 'trained on it'
OWN_GEL = -1
"""The number of the model's own gel."""
MEASURES = ('force_rmse_n', 'place_median_mm', 'armse_n', 'placed_armse_n', 'd_loc_mm', 'rmse_mc_n')
COMPARED = {'force': 'force_rmse_n', 'place': 'place_median_mm', 'aRMSE': 'placed_armse_n'}
"""Errors that are compared with the source's own; in the order of `Score.drawn`."""
PLACEMENTS, STRIDE = 89, 55
"""Placements of the grid of bins, evenly over one bin: a Fibonacci lattice (Niederreiter, Random Number Generation and
Quasi-Monte Carlo Methods, 1992, section 5)."""
DRAWS, DRAWS_SEED = 200, 9001


@dataclass(frozen=True)
class Score:
    """Scores of one readout on the test presses of one gel; `seconds` is the time of its calibration.

    `armse_n` is on the grid of the model, `placed_armse_n` the mean over placements of it. `covered` is the share of
    forces within the readout's 90 % interval; NaN if it states none. `drawn` are the values of `COMPARED` on resampled
    presses, with the same samples for every readout. `pressed_n` is the mean force of the presses.
    """

    gel: int
    presses: int
    way: str
    force_rmse_n: float
    place_median_mm: float
    armse_n: float
    placed_armse_n: float
    d_loc_mm: float
    rmse_mc_n: float
    covered: float
    form: str = ''
    seconds: float = 0.0
    tested: int = 0
    pressed_n: float = 1.0
    drawn: Float[np.ndarray, 'compared draws'] | None = field(default=None, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """Plain data for a file, without `drawn`."""
        fields = asdict(self)
        del fields['drawn']
        return fields

    def kept(self) -> dict[str, Any]:
        """Plain data for a part of a run, with `drawn`."""
        return {**self.as_dict(), 'drawn': None if self.drawn is None else self.drawn.tolist()}

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> Score:
        """The score from the data of `kept`."""
        return cls(**{**fields, 'drawn': None if fields['drawn'] is None else np.array(fields['drawn'])})


def score(gel: int, presses: int, way: str, readout: AnyReadout, tested: Dataset) -> Score:
    """The score of a readout on all samples of a data set, each of them a press."""
    from tactile_nodes.sensing import metrics

    read = [
        readout.read(values.astype(np.float32), tested.confidence[rest])
        for values, rest in zip(tested.features, tested.rest, strict=True)
    ]
    bins = np.stack([each.normal_force_n.reshape(-1) for each in read])
    labels = tested.labels(readout.bins)
    first = [each.contacts[0] for each in read]
    found = np.array([(each.x_mm, each.y_mm, each.force_n, each.sigma_mm) for each in first])
    away = np.hypot(*(found[:, :2] - tested.presses[:, :2]).T)
    off = metrics.total_errors_n(labels, bins)
    squares = placed_squares(found, tested.presses[:, [0, 1, 3]].astype(float), readout.bins)
    once = np.ones((1, len(away)))
    return Score(
        gel, presses, way, metrics.root_mean_square(off), float(np.median(away)), metrics.armse(labels, bins),
        float(_placed_armse(squares, once)[0]),
        metrics.location_error_mm(labels, bins, readout.bins), metrics.peak_rmse_n(labels, bins),
        metrics.coverage(off, np.array([each.total_sigma_n for each in read])),
        tested=len(away), pressed_n=float(tested.presses[:, 3].mean()),
        drawn=_drawn(off, away, squares, draws(len(away))),
    )  # fmt: skip


def placed_squares(
    found: Float[np.ndarray, 'n 4'], truth: Float[np.ndarray, 'n 3'], bins: BinGrid
) -> Float[np.ndarray, 'n placements bins']:
    """Squared errors of the bins' forces (N^2) for every placement of the grid.

    The estimate (x, y in mm, force in N, standard deviation of the place in mm) is spread over the bins as by
    `spread_over_bins`; the truth (x, y, force) is in one bin.
    """
    count = bins.rows * bins.cols
    squares = np.empty((len(found), PLACEMENTS, count), np.float32)
    numbers = np.arange(PLACEMENTS)
    aside = np.stack([numbers / PLACEMENTS, numbers * STRIDE / PLACEMENTS % 1.0], axis=1) - 0.5
    for number, (x, y) in enumerate((aside * np.array(bins.bin_size_mm)).tolist()):
        along_x = _shares(found[:, 0] + x, found[:, 3], bins.cols, bins.width_mm)
        along_y = _shares(found[:, 1] + y, found[:, 3], bins.rows, bins.height_mm)
        forces = (found[:, 2, None, None] * along_y[:, :, None] * along_x[:, None, :]).reshape(len(found), count)
        at = [bins.bin_of(*each) for each in (truth[:, :2] + np.array([x, y])).tolist()]
        forces[np.arange(len(found)), at] -= truth[:, 2]
        squares[:, number] = forces**2
    return squares


def _shares(
    at_mm: Float[np.ndarray, ' n'], sigma_mm: Float[np.ndarray, ' n'], count: int, size_mm: float
) -> np.ndarray:
    """Probability that places with normal errors lie in each of `count` equal intervals: (n, count)."""
    from scipy.special import ndtr

    borders = size_mm * (np.arange(1, count) / count - 0.5)
    below = ndtr((borders - at_mm[:, None]) / np.maximum(sigma_mm, 1e-6)[:, None])
    return np.diff(below, axis=1, prepend=0.0, append=1.0)


def draws(presses: int) -> Int[np.ndarray, 'draws presses']:
    """Resampled presses (the bootstrap: Efron and Tibshirani, 1993), the same in every run."""
    drawn: np.ndarray = np.random.default_rng(DRAWS_SEED).integers(presses, size=(DRAWS, presses))
    return drawn


def _drawn(
    off: Float[np.ndarray, ' n'],
    away: Float[np.ndarray, ' n'],
    squares: Float[np.ndarray, 'n placements bins'],
    drawn: Int[np.ndarray, 'draws n'],
) -> Float[np.ndarray, 'compared draws']:
    times = np.stack([np.bincount(each, minlength=len(off)) for each in drawn])
    force, place = np.sqrt(np.square(off)[drawn].mean(axis=1)), np.median(away[drawn], axis=1)
    return np.stack([force, place, _placed_armse(squares, times)])


def _placed_armse(
    squares: Float[np.ndarray, 'n placements bins'], times: Float[np.ndarray, 'draws n']
) -> Float[np.ndarray, ' draws']:
    """The mean over the placements of the aRMSE, with each press counted `times`."""
    summed = times.astype(np.float32) @ squares.reshape(len(squares), -1)
    armse: np.ndarray = np.sqrt(summed / times.sum(axis=1, keepdims=True)).mean(axis=1)
    return armse


@dataclass(frozen=True)
class Ratio:
    """Error relative to a level, for the median and the worst gel, with standard errors over the tested presses."""

    median: float
    worst: float
    median_error: float = 0.0
    worst_error: float = 0.0


def ratio(level: Score | Sequence[Score], chosen: Sequence[Score], measured: str, of_force: bool = False) -> Ratio:
    """The ratio of some gels' scores to a level, in one of `COMPARED`.

    The level is the source's score, or scores of the same gels in the same order. Standard errors are 0 without
    `drawn`. Two gels with twice and three times the source's error give 2.5 for the median and 3 for the worst. With
    `of_force` errors are relative to the mean force of the presses: twice the error on a gel twice as hard is 1.
    """
    name = COMPARED[measured]
    levels = [level] * len(chosen) if isinstance(level, Score) else list(level)
    both = list(zip(chosen, levels, strict=True))
    harder = np.array([each.pressed_n / own.pressed_n if of_force else 1.0 for each, own in both])
    of = np.array([getattr(each, name) / getattr(own, name) for each, own in both]) / harder
    row = list(COMPARED).index(measured)
    drawn = [each.drawn[row] / own.drawn[row] for each, own in both if not (each.drawn is None or own.drawn is None)]
    if len(drawn) < len(both):
        return Ratio(float(np.median(of)), float(of.max()))
    again = np.stack(drawn) / harder[:, None]
    return Ratio(
        float(np.median(of)), float(of.max()), float(np.median(again, axis=0).std()), float(again.max(axis=0).std())
    )  # fmt: skip
