"""Figures of merit over groups of samples: the paper's three, places and forces, light touches, rest."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.sensing import metrics
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float

NEAR_BORDER_MM = 0.3
EDGE_MM = 9.0
"""Two thirds of the reach of the paper's presses. Beyond it along one axis is the rim, along both axes a corner."""
DEPTHS_MM = ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0), (1.0, 2.0))
TOUCH_N = 0.02
"""A touch of this force should be detected."""
LIGHT_N = (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05, 1.0)
"""Borders between groups of light touches, by their true force."""
ALL = 'all presses'


@dataclass(frozen=True)
class PressScores:
    """Figures of merit over presses. The first three are the paper's; lengths in mm, forces in N.

    `missed` is the share whose total force stays below the model's contact threshold. Places are scored where the model
    estimates one.
    """

    presses: int
    armse_n: float
    d_loc_mm: float
    rmse_mc_n: float
    right_bin: float
    total_median_n: float
    total_p95_n: float
    total_rmse_n: float
    position_median_mm: float
    position_p95_mm: float
    missed: float


@dataclass(frozen=True)
class RestScores:
    """Scores without contact: the total force that the model reports, and how often it reports a contact.

    `force_coverage` is the share of frames whose 90 % interval of the total contains zero.
    """

    frames: int
    total_mean_n: float
    total_rms_n: float
    total_largest_n: float
    largest_bin_n: float
    false_contacts: float
    force_coverage: float


@dataclass(frozen=True)
class LightBand:
    """Touches of similar true force: the share that is detected, and the errors of force and place."""

    low_n: float
    high_n: float
    touches: int
    detected: float
    total_rmse_n: float
    position_median_mm: float


@dataclass(frozen=True)
class LightScores:
    """Touches lighter than the paper's data. `detected` is the share among those of at least `TOUCH_N`.

    The place is scored for detected touches. `threshold_n` is the model's contact threshold. The coverages are those of
    its 90 % intervals.
    """

    touches: int
    of_20_mn: int
    detected: float
    threshold_n: float
    force_coverage: float
    place_coverage: float
    bands: tuple[LightBand, ...]


def groups_of(found: Predictions) -> dict[str, np.ndarray]:
    """Groups of samples for scoring: all presses, by distance to bin borders, by region, and by depth."""
    near = border_distances_mm(found.place_mm, found.bins) < NEAR_BORDER_MM
    groups = {
        ALL: np.ones(len(found), bool),
        f'within {NEAR_BORDER_MM} mm of a bin border': near,
        'away from bin borders': ~near,
        **regions_of(found.place_mm),
        **depths_of(found.depth_mm),
    }
    chosen = {name: members & found.touched for name, members in groups.items()}
    return {name: members for name, members in chosen.items() if members.any()}


def regions_of(place_mm: Float[np.ndarray, 'samples 2']) -> dict[str, np.ndarray]:
    """Middle, rim and corners of the surface. A place on the border belongs to the middle."""
    beyond = (np.abs(place_mm) > EDGE_MM).sum(axis=1)
    names = f'middle, {2 * EDGE_MM:g}x{2 * EDGE_MM:g} mm', 'rim', 'corners'
    return {name: beyond == axes for axes, name in enumerate(names)}


def depths_of(depth_mm: Float[np.ndarray, ' samples']) -> dict[str, np.ndarray]:
    """Groups by depth. The deepest presses of the paper are 2 mm deep, and belong to the last group."""
    slack = 1e-6  # tolerance for the rounding of recorded decimal depths
    deepest = DEPTHS_MM[-1][1]
    return {
        f'{low:g} to {high:g} mm deep': (depth_mm >= low - slack)
        & ((depth_mm <= high + slack) if high == deepest else (depth_mm < high - slack))
        for low, high in DEPTHS_MM
    }


def border_distances_mm(place_mm: Float[np.ndarray, 'samples 2'], bins: BinGrid) -> Float[np.ndarray, ' samples']:
    """Distance of each place to the nearest border between two bins."""
    return np.array([bins.border_distance_mm(x, y) for x, y in place_mm.tolist()])


def score_groups(found: Predictions) -> dict[str, PressScores]:
    """Scores of each group that has members."""
    return {name: score_presses(found[members]) for name, members in groups_of(found).items()}


def score_presses(found: Predictions) -> PressScores:
    """Scores over presses. There must be at least one."""
    off_n = np.abs(found.force_error_n)
    placed = found.away_mm[np.isfinite(found.away_mm)]
    return PressScores(
        presses=len(found),
        armse_n=metrics.armse(found.true_n, found.found_n),
        d_loc_mm=metrics.location_error_mm(found.true_n, found.found_n, found.bins),
        rmse_mc_n=metrics.peak_rmse_n(found.true_n, found.found_n),
        right_bin=metrics.right_bin_share(found.true_n, found.found_n),
        total_median_n=percentile(off_n, 50),
        total_p95_n=percentile(off_n, 95),
        total_rmse_n=metrics.root_mean_square(off_n),
        position_median_mm=percentile(placed, 50),
        position_p95_mm=percentile(placed, 95),
        missed=float((~found.detected).mean()),
    )


def score_rest(found: Predictions) -> RestScores | None:
    """Scores over the frames without contact; None if there are none."""
    rest = found[~found.touched]
    if not len(rest):
        return None
    return RestScores(
        frames=len(rest),
        total_mean_n=float(rest.total_n.mean()),
        total_rms_n=metrics.root_mean_square(rest.total_n),
        total_largest_n=float(np.abs(rest.total_n).max()),
        largest_bin_n=float(np.abs(rest.found_n).max()),
        false_contacts=float(rest.detected.mean()),
        force_coverage=metrics.coverage(rest.total_n, rest.total_sigma_n),
    )


def score_light(found: Predictions) -> LightScores:
    """Scores over light touches."""
    firm = found.touched & (found.force_n >= TOUCH_N)
    touches, seen = found[found.touched], found[found.touched & found.detected]
    bands = (
        _band(found[found.touched & (found.force_n >= low) & (found.force_n < high)], low, high)
        for low, high in itertools.pairwise(LIGHT_N)
    )
    return LightScores(
        touches=len(touches),
        of_20_mn=int(firm.sum()),
        detected=share(found.detected[firm]),
        threshold_n=found.contact_threshold_n,
        force_coverage=metrics.coverage(touches.force_error_n, touches.total_sigma_n),
        place_coverage=metrics.coverage(seen.place_error_mm, np.column_stack([seen.position_sigma_mm] * 2)),
        bands=tuple(band for band in bands if band.touches),
    )


def _band(found: Predictions, low_n: float, high_n: float) -> LightBand:
    seen = found.away_mm[found.detected]
    return LightBand(
        low_n=low_n,
        high_n=high_n,
        touches=len(found),
        detected=share(found.detected),
        total_rmse_n=metrics.root_mean_square(found.force_error_n),
        position_median_mm=percentile(seen[np.isfinite(seen)], 50),
    )


def percentile(values: Float[np.ndarray, ' samples'], level: float) -> float:
    """Percentile of the values; NaN if there are none."""
    return float(np.percentile(values, level)) if len(values) else float('nan')


def share(members: np.ndarray) -> float:
    """The share of true values; NaN if there are none."""
    return float(members.mean()) if len(members) else float('nan')
