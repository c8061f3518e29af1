"""Plots of a data set: places of presses, force against depth, distribution of forces, and one label."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.figures import figure, save


def draw(presses: RecordedPresses, file: Path) -> None:
    """Write the picture. The file's extension selects the image format.

    Raises:
        ConfigurationError: matplotlib is not installed, or does not know the extension.
        DatasetError: the file cannot be written.
    """
    drawn = figure(11, 9)
    axes = drawn.subplots(2, 2)
    _coverage(axes[0, 0], presses)
    _curves(axes[0, 1], presses)
    _histogram(axes[1, 0], presses)
    _force_map(drawn, axes[1, 1], presses)
    drawn.suptitle(f'{_of(presses)} (data set {presses.fingerprint})')
    save(drawn, file)


def _of(presses: RecordedPresses) -> str:
    gel = presses.card['gel']['id']
    return f'{len(np.unique(presses.press_number))} presses' + (f' of gel {gel}' if gel else '')


def _coverage(axis: Any, presses: RecordedPresses) -> None:
    places, counts = np.unique(np.round(presses.position_mm[presses.contact], 3), axis=0, return_counts=True)
    shown = axis.scatter(*places.T, c=counts, s=max(4, 2000 / len(places) ** 0.8), cmap='viridis', vmin=0)
    axis.figure.colorbar(shown, ax=axis, label='samples')
    bins = presses.bins
    (left, top), (width, height) = bins.origin_mm, bins.bin_size_mm
    axis.set_xticks([left + col * width for col in range(bins.cols + 1)], minor=True)
    axis.set_yticks([top + row * height for row in range(bins.rows + 1)], minor=True)
    axis.grid(which='minor', linewidth=0.5)
    # y points down, as in the image
    axis.set(
        title='coverage, and the bins', xlabel='x [mm]', ylabel='y [mm]', aspect='equal',
        xlim=(left, left + bins.width_mm), ylim=(top + bins.height_mm, top),
    )  # fmt: skip


def _curves(axis: Any, presses: RecordedPresses) -> None:
    depth, force = presses.depth_mm[presses.contact], presses.force_n[presses.contact]
    axis.plot(depth, force, '.', markersize=3, alpha=0.3, label='a press')
    depths, member = np.unique(np.round(depth, 3), return_inverse=True)
    if len(depths) <= 16:
        middle = [float(np.median(force[member.reshape(-1) == number])) for number in range(len(depths))]
        axis.plot(depths, middle, 'k-', linewidth=1, label='median')
    axis.legend(loc='upper left')
    known = '' if np.isfinite(depth).any() else ': no depth is known'
    axis.set(title=f'force over depth{known}', xlabel='depth [mm]', ylabel='force [N]', xlim=(0, None))


def _histogram(axis: Any, presses: RecordedPresses) -> None:
    axis.hist(presses.force_n[presses.contact], bins=40)
    axis.set(title='forces', xlabel='force [N]', ylabel='samples')


def _force_map(figure: Any, axis: Any, presses: RecordedPresses) -> None:
    chosen = int(np.argmax(presses.force_n))
    bins = presses.bins
    (left, top), forces = bins.origin_mm, presses.labels[chosen].reshape(bins.rows, bins.cols)
    extent = left, left + bins.width_mm, top + bins.height_mm, top
    shown = axis.imshow(forces, extent=extent, cmap='magma', vmin=0)
    figure.colorbar(shown, ax=axis, label='force [N]')
    axis.plot(*presses.position_mm[chosen], '+', color='cyan')
    axis.set(title=_title(presses, chosen), xlabel='x [mm]', ylabel='y [mm]')


def _title(presses: RecordedPresses, chosen: int) -> str:
    depth_mm = presses.depth_mm[chosen]
    known = f' at {depth_mm:g} mm' if np.isfinite(depth_mm) else ''
    return f'label of press {presses.press[chosen]}: {presses.force_n[chosen]:.3f} N{known}'
