"""Errors of the estimates for a contact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from benchmarks.contacts.cases import Case
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.scene import truth_of_touch
from tactile_nodes.simulation.touch.table import node_forces, over_bins

FORCE = types.ForceDistribution
COVERED = 1.645
"""Number of standard deviations to each side that contain 90 % of a normal error."""

LEAST_SHEAR_N, LEAST_TORSION_N_MM = 0.05, 1.0
LEAST_BIN_SHARE = 0.01
"""Share of the total; bins with less, both estimated and true, do not count for the intervals of bins."""

MAP = 27
UNKNOWN = math.nan


@dataclass(frozen=True)
class Score:
    """Scores of one frame. Forces in N, lengths in mm; NaN if there is no estimate or no true value."""

    family: str
    true_n: float
    misplaced: float
    squared_n2: float
    total_n: float
    centre_mm: float
    shear: float
    torsion: float
    map_r: float
    total_held: float
    shear_held: float
    bins_held: float
    ok: bool
    explanation: int
    cpu_ms: float
    nominal_times: float
    least_cpu_ms: float


def score(
    case: Case,
    force: types.ForceDistribution,
    field: types.ForceField | None,
    gel: Gel,
    cpu_ms: tuple[float, float],
    nominal_n: float,
) -> Score:
    """Score one contact; a frame with NaN counts as a frame without force.

    `cpu_ms` holds the times of the whole chain, and of flow and readout alone.
    """
    bins = BinGrid(force.rows, force.cols, *gel.sides_mm)
    truth = truth_of_touch(case.touch, case.table, gel.shear_modulus_mpa, bins)
    estimated = np.nan_to_num(np.asarray(force.normal_force, float)).reshape(bins.rows, bins.cols)
    off, total = estimated - truth.normal_force_n, float(truth.total_n)
    shear = np.array(truth.shear_n)
    return Score(
        family=case.family,
        true_n=total,
        misplaced=float(np.abs(off).sum() / 2 / total),
        squared_n2=float(np.square(off).mean()),
        total_n=float(estimated.sum() - total),
        centre_mm=_centre(estimated, bins, field, truth.position_mm),
        shear=_shear(force, shear),
        torsion=_torsion(force, truth.torsion_n_mm),
        map_r=_alike(case, field, gel, estimated),
        total_held=_held(estimated.sum() - total, force.total_sigma),
        shear_held=_shear_held(force, shear),
        bins_held=_bins_held(force, off, truth.normal_force_n, estimated),
        ok=force.status == FORCE.STATUS_OK,
        explanation=int(force.explanation),
        cpu_ms=cpu_ms[0],
        least_cpu_ms=cpu_ms[1],
        nominal_times=abs(float(estimated.sum()) - total) / nominal_n if nominal_n > 0 else UNKNOWN,
    )


def _centre(
    estimated: np.ndarray, bins: BinGrid, field: types.ForceField | None, true_mm: tuple[float, float]
) -> float:
    """Distance of the centres of pressure; from the fine map if there is one, else from the bins."""
    grid, weight = bins, estimated
    if field is not None and len(field.pressure):
        grid = BinGrid(field.rows, field.cols, bins.width_mm, bins.height_mm)
        weight = np.asarray(field.pressure, float).reshape(field.rows, field.cols)
    if not weight.sum() > 0:
        return UNKNOWN
    centre = np.einsum('yx,yxc->c', weight, grid.centres_mm) / weight.sum()
    return float(np.hypot(*(centre - np.array(true_mm))))


def _shear(force: types.ForceDistribution, true_n: np.ndarray) -> float:
    size = float(np.hypot(*true_n))
    if not len(force.shear_force_x) or size < LEAST_SHEAR_N:
        return UNKNOWN
    estimated = np.array([float(np.sum(force.shear_force_x)), float(np.sum(force.shear_force_y))])
    return float(np.hypot(*(estimated - true_n)) / size)


def _torsion(force: types.ForceDistribution, true_n_mm: float) -> float:
    """Relative error of the torsion, if there is exactly one contact."""
    if len(force.contacts) != 1 or abs(true_n_mm) < LEAST_TORSION_N_MM:
        return UNKNOWN
    return abs(force.contacts[0].torsion * 1e3 - true_n_mm) / abs(true_n_mm)


def _alike(case: Case, field: types.ForceField | None, gel: Gel, estimated: np.ndarray) -> float:
    """Correlation of the map with the truth on 27x27 cells; bins are divided evenly, a fine map is interpolated."""
    place, acting = node_forces(case.table, case.touch)
    fine = BinGrid(MAP, MAP, *gel.sides_mm)
    true = over_bins(place, acting, case.table.node_size_mm, fine)[..., 2]
    source, way = estimated, cv2.INTER_NEAREST
    if field is not None and len(field.pressure):
        source, way = np.asarray(field.pressure, float).reshape(field.rows, field.cols), cv2.INTER_LINEAR
    mapped = cv2.resize(source, (MAP, MAP), interpolation=way)
    return float(np.corrcoef(mapped.ravel(), true.ravel())[0, 1]) if mapped.std() > 0 else 0.0


def _held(off: float, sigma: float) -> float:
    return float(abs(off) <= COVERED * sigma) if math.isfinite(sigma) else UNKNOWN


def _shear_held(force: types.ForceDistribution, true_n: np.ndarray) -> float:
    """Share of the two components of the net shear within their intervals."""
    covariance = np.asarray(force.wrench_covariance, float).reshape(6, 6)
    if covariance[0, 0] < 0 or not len(force.shear_force_x):
        return UNKNOWN
    estimated = np.array([force.wrench.force.x, force.wrench.force.y])
    return float(np.mean(np.abs(estimated - true_n) <= COVERED * np.sqrt(np.diag(covariance)[:2])))


def _bins_held(force: types.ForceDistribution, off: np.ndarray, true: np.ndarray, estimated: np.ndarray) -> float:
    if not len(force.normal_force_sigma):
        return UNKNOWN
    sigma = np.asarray(force.normal_force_sigma, float).reshape(off.shape)
    counted = np.maximum(true, estimated) > LEAST_BIN_SHARE * max(float(true.sum()), float(estimated.sum()))
    return float((np.abs(off) <= COVERED * sigma)[counted].mean()) if counted.any() else UNKNOWN


def summed(scores: Sequence[Score]) -> dict[str, float]:
    """Medians, root mean squares and shares over many frames."""
    column: Mapping[str, np.ndarray] = {
        name: np.array([asdict(each)[name] for each in scores], float)
        for name in Score.__dataclass_fields__ if name != 'family'
    }  # fmt: skip
    ok = column['ok'] > 0
    return {
        'frames': len(scores),
        'misplaced': float(column['misplaced'].mean()),
        'armse_n': float(np.sqrt(column['squared_n2'].mean())),
        'total_rms_n': float(np.sqrt(np.square(column['total_n']).mean())),
        'total_median': float(np.median(np.abs(column['total_n']) / column['true_n'])),
        **{f'{name}_median': _median(column[name]) for name in ('centre_mm', 'shear', 'torsion')},
        'map_r': float(column['map_r'].mean()),
        **{name: _mean(column[name]) for name in ('total_held', 'shear_held', 'bins_held')},
        'ok': float(ok.mean()),
        'worst_while_ok': float(column['nominal_times'][ok].max()) if ok.any() else UNKNOWN,
        'field': float((column['explanation'] == FORCE.EXPLANATION_FIELD).mean()),
        'cpu_ms': float(np.median(column['cpu_ms'])),
        'cpu_95_ms': float(np.percentile(column['cpu_ms'], 95)),
        'least_cpu_ms': float(np.median(column['least_cpu_ms'])),
    }


def by_family(scores: Sequence[Score]) -> dict[str, Any]:
    """The same for each family."""
    families = dict.fromkeys(each.family for each in scores)
    return {family: summed([each for each in scores if each.family == family]) for family in families}


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else UNKNOWN


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else UNKNOWN
