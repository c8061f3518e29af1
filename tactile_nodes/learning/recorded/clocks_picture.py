"""Residuals of the clock fits of a bag: a point for each edge, the bound, and edges without a match."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.learning.figures import figure, save
from tactile_nodes.learning.recorded.clocks import Clock, Clocks
from tactile_nodes.sensing.sync.clocks import ClockFit, Refusal


def draw(clocks: Clocks, file: Path) -> None:
    """Write the picture, a strip for each recorder. The file's extension selects the image format.

    Raises:
        ConfigurationError: matplotlib is not installed, or does not know the extension.
        DatasetError: the file cannot be written.
    """
    strips = max(1, len(clocks.others))
    drawn = figure(10, 1 + 2.6 * strips)
    axes = drawn.subplots(strips, 1, squeeze=False, sharex=True)[:, 0]
    for axis, clock in zip(axes, clocks.others, strict=False):
        _strip(axis, clock, clocks)
    axes[-1].set_xlabel(f'time by {clocks.reference} since its first edge [s]')
    drawn.suptitle(f"residuals of the edges' times after the fit to the clock of {clocks.reference}")
    save(drawn, file)


def _strip(axis: Any, clock: Clock, clocks: Clocks) -> None:
    fit = clock.outcome
    if isinstance(fit, Refusal):
        axis.set(title=f'{clock.recorder}: {fit.reason.value}', yticks=[])
        axis.text(0.5, 0.5, fit.text, ha='center', va='center', wrap=True, transform=axis.transAxes)
        return
    at_s, off_ms = residuals(clock, clocks)
    half_ms = clock.edges.uncertainty_s[fit.device_index] * 1e3
    axis.errorbar(at_s, off_ms, yerr=half_ms, fmt='.', markersize=4, linewidth=0.5, label='matched, with half width')
    alone = np.setdiff1d(np.arange(len(clock.edges)), fit.device_index)
    axis.plot(_since(fit, clock, clocks, alone), np.zeros(len(alone)), 'rx', markersize=5, label='without a partner')
    axis.axhspan(-fit.bound_s * 1e3, fit.bound_s * 1e3, alpha=0.15, label='known to')
    axis.legend(loc='upper right', fontsize='small')
    axis.set(
        title=f'{clock.recorder}: {fit.offset_s:+.6f} s, {fit.drift_ppm:+.2f} ppm, {fit.inliers} of {len(clock.edges)}',
        ylabel='left [ms]',
    )


def residuals(clock: Clock, clocks: Clocks) -> tuple[np.ndarray, np.ndarray]:
    """For each matched edge, the reference's time [s] and how far the corrected time lies before it [ms]."""
    fit = clock.outcome
    assert isinstance(fit, ClockFit)
    host_ns = clocks.shared.stamp_ns[fit.host_index]
    left_ns = host_ns - fit.host_ns(clock.edges.stamp_ns[fit.device_index])
    return (host_ns - clocks.shared.stamp_ns[0]) / NS_PER_S, left_ns / 1e6


def _since(fit: ClockFit, clock: Clock, clocks: Clocks, rows: np.ndarray) -> np.ndarray:
    since_s: np.ndarray = (fit.host_ns(clock.edges.stamp_ns[rows]) - clocks.shared.stamp_ns[0]) / NS_PER_S
    return since_s
