"""Plots of a model's errors: over the surface, estimated against true force, and coverage of its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.uncertainty import Uncertainty, force_uncertainty, position_uncertainty
from tactile_nodes.learning.figures import figure, save
from tactile_nodes.sensing.geometry import BinGrid

EVALUATION_DPI = 110
MOST_CELLS = 12
"""Most cells of the error maps along x and along y. With few presses there are fewer."""
FEWEST_MAPPED = 128
"""With fewer presses, each is drawn separately instead of medians of cells."""
LEAST_IN_CELL = 3
"""A cell with fewer presses stays empty."""


def draw(found: Predictions, title: str, file: Path) -> None:
    """Write the picture. The file's extension selects the image format.

    Raises:
        ConfigurationError: matplotlib is not installed, or does not know the extension.
        DatasetError: the file cannot be written.
    """
    drawn, axes = subplots(2, 3)
    presses = found[found.touched]
    force, place = force_uncertainty(found), position_uncertainty(found)
    _map(axes[0, 0], presses, presses.away_mm, 'error of the place', 'mm')
    _map(axes[0, 1], presses, 1000 * np.abs(presses.force_error_n), 'error of the force', 'mN')
    _true_against_found(axes[0, 2], presses)
    _coverage(axes[1, 0], force, place)
    _curve(axes[1, 1], force, place)
    axes[1, 2].remove()
    drawn.suptitle(f'{title}: {len(presses)} presses not used in training')
    save(drawn, file, EVALUATION_DPI)


def subplots(rows: int, cols: int) -> tuple[Any, Any]:
    """A figure and its axes, (rows, cols).

    Raises:
        ConfigurationError: matplotlib is not installed.
    """
    drawn = figure(5 * cols, 4.4 * rows)
    return drawn, drawn.subplots(rows, cols, squeeze=False)


def _map(axis: Any, presses: Predictions, values: np.ndarray, title: str, unit: str) -> None:
    reach = max(1.05 * float(np.abs(presses.place_mm).max()), 1.0)
    if len(presses) < FEWEST_MAPPED:
        colours: dict[str, Any] = {'cmap': 'magma_r', 'vmin': 0, 'vmax': _brightest(values)}
        shown = axis.scatter(*presses.place_mm.T, c=values, s=30, edgecolors='0.4', linewidths=0.5, **colours)
    else:
        cells = int(np.clip(np.sqrt(len(presses) / 8), 1, MOST_CELLS))
        medians = cell_medians(presses.place_mm, values, np.linspace(-reach, reach, cells + 1))
        colours = {'cmap': 'magma_r', 'vmin': 0, 'vmax': _brightest(medians)}
        # y points down, as in the image
        shown, title = axis.imshow(medians, extent=(-reach, reach, reach, -reach), **colours), f'median {title}'
    axis.figure.colorbar(shown, ax=axis, label=unit, extend='max')
    _bin_borders(axis, presses.bins)
    axis.set(title=title, xlabel='x [mm]', ylabel='y [mm]', aspect='equal', xlim=(-reach, reach), ylim=(reach, -reach))


def _brightest(errors: np.ndarray) -> float | None:
    """Upper limit of the colour scale: one outlier must not hide all other errors."""
    shown = errors[np.isfinite(errors)]
    return 1.2 * float(np.percentile(shown, 95)) if len(shown) else None


def cell_medians(place_mm: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Median of the finite values in each cell, rows along +y; NaN where there are too few."""
    from scipy.stats import binned_statistic_2d

    known = np.isfinite(values)
    y, x, known_values = place_mm[known, 1], place_mm[known, 0], values[known]
    medians, counts = (
        binned_statistic_2d(y, x, known_values, kind, [edges, edges]).statistic for kind in ('median', 'count')
    )
    return np.where(counts >= LEAST_IN_CELL, medians, np.nan)


def _bin_borders(axis: Any, bins: BinGrid) -> None:
    (left, top), (width, height) = bins.origin_mm, bins.bin_size_mm
    for col in range(1, bins.cols):
        axis.axvline(left + col * width, color='grey', linewidth=0.4)
    for row in range(1, bins.rows):
        axis.axhline(top + row * height, color='grey', linewidth=0.4)


def _true_against_found(axis: Any, presses: Predictions) -> None:
    high = 1.05 * float(max(presses.force_n.max(), presses.total_n.max()))
    known, size = np.isfinite(presses.depth_mm), 4 if len(presses) >= FEWEST_MAPPED else 16
    axis.scatter(presses.force_n[~known], presses.total_n[~known], s=size)  # unknown depth: presses by hand
    if known.any():
        deep = presses[known]
        shown = axis.scatter(deep.force_n, deep.total_n, c=deep.depth_mm, s=size, cmap='viridis')
        axis.figure.colorbar(shown, ax=axis, label='depth [mm]')
    axis.plot([0, high], [0, high], 'k-', linewidth=0.6)
    axis.set(title='force', xlabel='true [N]', ylabel='found [N]', xlim=(0, high), ylim=(0, high), aspect='equal')


def _coverage(axis: Any, force: Uncertainty | None, place: Uncertainty | None) -> None:
    axis.plot([50, 100], [50, 100], 'k-', linewidth=0.6, label='as stated')
    for stated, name, style in _stated(force, place):
        levels = [float(level.rstrip('%')) for level in stated.levels]
        axis.plot(levels, [100 * share for share in stated.levels.values()], style, label=name)
    axis.legend(loc='best')
    axis.set(title='coverage of the intervals', xlabel='stated [%]', ylabel='true values inside [%]')
    _tell_if_none(axis, force, place)


def _curve(axis: Any, force: Uncertainty | None, place: Uncertainty | None) -> None:
    shown = [
        (name, style, 1000 * np.array([[each.stated, each.actual] for each in stated.curve]))
        for stated, name, style in _stated(force, place)
    ]
    for name, style, curve in shown:
        axis.loglog(curve[:, 0], curve[:, 1], style, label=f'{name} [{"mN" if name == "force" else "µm"}]')
    if shown:
        ends = np.concatenate([curve.reshape(-1) for _, _, curve in shown])
        low, high = max(float(ends.min()), 1e-3), float(ends.max())
        axis.loglog([low, high], [low, high], 'k-', linewidth=0.6)
        axis.legend(loc='best')
    axis.set(title='error over stated uncertainty (tenths)', xlabel='stated, 1 sigma', ylabel='actual, RMS')
    _tell_if_none(axis, force, place)


def _stated(force: Uncertainty | None, place: Uncertainty | None) -> list[tuple[Uncertainty, str, str]]:
    both = ((force, 'force', 'C0o-'), (place, 'place along an axis', 'C1s-'))
    return [(stated, name, style) for stated, name, style in both if stated is not None]


def _tell_if_none(axis: Any, force: Uncertainty | None, place: Uncertainty | None) -> None:
    if force is None and place is None:
        axis.text(0.5, 0.5, 'the model states no uncertainty', ha='center', transform=axis.transAxes)
