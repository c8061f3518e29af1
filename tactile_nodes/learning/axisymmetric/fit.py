"""Measure a gel's axisymmetric response: in turns each region's numbers and the profiles that all regions share.

Given the profiles, a region's couplings and place follow from least squares, and the profiles from those in turn. Both
errors fall with every turn, and a dozen turns suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.axisymmetric.calibration import Judged, calibrated, with_correction
from tactile_nodes.learning.axisymmetric.regions import (
    FIRST_DOUBT,
    Expected,
    Presses,
    Shared,
    measured_doubt,
    views,
)
from tactile_nodes.learning.axisymmetric.steps import fit_regions
from tactile_nodes.learning.config import AxisymmetricConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.fit import curvature, inner_held_out, noise_scaling, require_enough
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import BEND_MM, CORE_MM, DISTANCES, AxisymmetricResponse
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float

LEAST_PRESSES = 100
ALONE = 3
"""Turns with one profile of each kind before the others are added."""
PAIRS = 60_000
"""Pairs of a press and a region that a turn fits the profiles to."""
SMOOTHING = 1e-3
MARGIN = 1.02
SMEAR = Shared(np.zeros(4), np.array([0.0, 0.0, 1.0, 0.3]))
"""Fitted from the turn on in which other profiles are added."""
DEPTH_SPREAD = 0.2
"""Initial spread between regions: of the depth of their markers when second profiles are added, and of the effect of
their viewing angle when third ones are."""


def fit_axisymmetric(
    dataset: Dataset, held_out: np.ndarray, config: AxisymmetricConfig, bins: BinGrid, progress: Progress
) -> AxisymmetricReadout:
    """The readout of a data set; correction and uncertainty are measured on presses at held-out places.

    Samples of `held_out` (a boolean for each) are never used.

    Raises:
        TooFewPressesError: too few presses or images of the untouched gel.
        DatasetError: all presses are at one place.
    """
    touched = dataset.presses[:, 2] > 0
    untouched = np.flatnonzero(~held_out & ~touched)
    used = np.flatnonzero(~held_out & touched)
    require_enough('an axisymmetric response', len(untouched), len(used), LEAST_PRESSES)
    scaling = noise_scaling(dataset, untouched, config)
    inner = inner_held_out(dataset, used, config.seed)
    if inner.all():
        raise DatasetError('an axisymmetric response needs presses at many places, so that some can be held out')
    presses, judges = (Presses.of(dataset, used[chosen], scaling) for chosen in (~inner, inner))
    with progress.bar('measuring the response', config.turns + 2) as bar:
        response = measured(scaling, bins, presses, config, bar.advance)
        doubt = measured_doubt(response, judges)
        reach = float(np.abs(presses.contacts[:, :2]).max())
        correction = Correction.none(reach, response.hardest_n)
        readout = AxisymmetricReadout(scaling, response, doubt, correction, bins)
        judged = Judged.of(readout, dataset, used[inner])
        readout = with_correction(judged)
        bar.advance(1, 'uncertainty')
        judged = replace(judged, readout=readout)  # the fits are those before any correction
        readout = replace(readout, calibration=calibrated(judged, dataset, untouched))
        bar.advance(1)
    return replace(readout, most_contacts=config.most_contacts)


def measured(
    scaling: InputScaling,
    bins: BinGrid,
    presses: Presses,
    config: AxisymmetricConfig,
    advance: Callable[[], object],
) -> AxisymmetricResponse:
    """The response fitted to presses on a gel."""
    response = first_guess(scaling, bins, float(presses.contacts[:, 2].max()) * MARGIN, config.levels)
    random = np.random.default_rng(config.seed)
    for turn in range(config.turns):
        response = _turn(response, presses, config, turn, random)
        advance()
    return response


def first_guess(scaling: InputScaling, bins: BinGrid, hardest_n: float, levels: int) -> AxisymmetricResponse:
    """Regions spread evenly over the surface, as they are over the image, with unit gain for lateral motion.

    Vertical motion is seen outwards, and more so further from the image centre.
    """
    view = views(scaling.trusted)
    lateral = np.tile(np.eye(2), (len(view), 1, 1))
    places = view * np.array([bins.width_mm, bins.height_mm]) / 2
    profiles = np.zeros((2, DISTANCES.count, SplineAxis(0.0, hardest_n, levels).count))
    return AxisymmetricResponse(profiles, 1, hardest_n, places, np.concatenate([lateral, view[:, :, None]], axis=2))


def _turn(
    response: AxisymmetricResponse, presses: Presses, config: AxisymmetricConfig, turn: int, random: np.random.Generator
) -> AxisymmetricResponse:
    """The profiles, then the regions; from a few presses in early turns, from many in the last ones."""
    few = presses.take(random.permutation(len(presses))[: config.presses_per_turn])
    if turn == 0:
        response = fit_profiles(response, few, random)
    last = turn == config.turns - 1
    chosen = presses.take(slice(0, config.most_presses)) if last else few
    for _ in range(2):
        response = fit_regions(
            response, chosen, Expected.around(response), FIRST_DOUBT, SMEAR if turn >= ALONE else None
        )
    if last:
        return response
    if turn >= ALONE - 1:
        response = _with_more(response, config, random)
    return fit_profiles(response, presses.take(random.permutation(len(presses))[: 2 * config.presses_per_turn]), random)


def _with_more(
    response: AxisymmetricResponse, config: AxisymmetricConfig, random: np.random.Generator
) -> AxisymmetricResponse:
    """One more profile of each kind, up to the wanted number; regions that differ separate them."""
    lateral, couplings, profiles = response.lateral, response.couplings, response.profiles
    unlike = _unlike(response.places, random)
    if lateral < config.lateral:
        more = couplings[:, :, :2] * unlike[(lateral - 1) % 2]
        couplings = np.concatenate([couplings[:, :, : 2 * lateral], more, couplings[:, :, 2 * lateral :]], axis=2)
        profiles = np.insert(profiles, lateral, 0.0, axis=0)
        lateral += 1
    if (vertical := len(profiles) - lateral) < config.vertical:
        first = couplings[:, :, 2 * lateral : 2 * lateral + 1]
        couplings = np.concatenate([couplings, first * unlike[(vertical - 1) % 2]], axis=2)
        profiles = np.insert(profiles, len(profiles), 0.0, axis=0)
    return replace(response, lateral=lateral, couplings=couplings, profiles=profiles)


def _unlike(places: Float[np.ndarray, 'regions 2'], random: np.random.Generator) -> list[np.ndarray]:
    """Initial differences between regions for the profiles of number 1 and 2: (regions, 1, 1) each.

    The second profiles describe depth, which is random for each marker. The third ones describe the viewing angle.
    Towards the image's rim a region sees markers of many depths along a line, which blurs the motion by the square
    of that angle's tangent.
    """
    aside = np.square(places).sum(axis=1)
    by_angle = (aside - aside.mean()) / max(float(aside.std()), 1e-9)
    return [DEPTH_SPREAD * each[:, None, None] for each in (random.normal(size=len(places)), by_angle)]


def fit_profiles(response: AxisymmetricResponse, presses: Presses, random: np.random.Generator) -> AxisymmetricResponse:
    """The profiles that explain the presses best, smooth along distance and force; mainly from pairs near the press."""
    weight = np.sqrt(presses.certainty) / np.sqrt(
        1 + presses.certainty * (0.07**2) * np.square(presses.motion).sum(axis=-1, keepdims=True)
    )
    distance = response.distances_mm(presses.contacts)
    likely = ((1 + distance / 2) ** -1.5 * (presses.certainty[..., 0] > 0)).ravel()
    count = min(PAIRS, int((likely > 0).sum()) // 2)
    chosen = weighted_choice(random, likely, count)
    press, region = np.divmod(chosen, distance.shape[1])
    shape = response.profiles.shape
    square, right = np.zeros((response.profiles.size,) * 2), np.zeros(response.profiles.size)
    for channel in (0, 1):
        design = _profile_design(response, presses.contacts[press], region, channel)
        heavy = scipy.sparse.diags_array(weight[press, region, channel]) @ design
        square = square + (heavy.T @ heavy).toarray()
        right = right + heavy.T @ (presses.motion[press, region, channel] * weight[press, region, channel])
    size = float(np.trace(square)) / len(square)
    rough = np.kron(np.eye(shape[0]), curvature(shape[1:]))
    solved = np.linalg.solve(square + size * (SMOOTHING * rough + 1e-6 * np.eye(len(square))), right)
    return replace(response, profiles=solved.reshape(shape))


def weighted_choice(random: np.random.Generator, likely: Float[np.ndarray, ' n'], count: int) -> np.ndarray:
    """A weighted random sample without replacement; items of zero weight are never drawn.

    Each item gets a random waiting time, shorter for larger weights, and the first ones are taken (Efraimidis and
    Spirakis, Information Processing Letters 97, 2006). Rounding of a weight changes one pair at the edge at most.
    NumPy's `choice` draws duplicates again, so there one rounding changes all later items.
    """
    wait = random.exponential(size=likely.size)
    late = np.divide(wait, likely, out=np.full(likely.size, np.inf), where=likely > 0)
    return np.sort(np.argpartition(late, count - 1)[:count])


def _profile_design(
    response: AxisymmetricResponse, contacts: Float[np.ndarray, 'n 3'], region: np.ndarray, channel: int
) -> scipy.sparse.csr_array:
    """Design matrix: motion of pairs of press and region by profile coefficients; 16 nonzeros a profile count."""
    away = response.away_of(contacts, region)
    distance = np.hypot(*away.T) + 1e-9
    unit = away / distance[:, None] * np.tanh(distance / CORE_MM)[:, None]
    i, near = DISTANCES.weights_of(np.arcsinh(distance / BEND_MM))
    k, force = response.force.weights_of(contacts[:, 2])
    four, count = np.arange(4), len(contacts)
    forces = force[0] * contacts[:, 2:]
    levels = response.profiles.shape[2]
    column = ((i[:, None] + four)[:, :, None] * levels + (k[:, None] + four)[:, None, :]).reshape(count, 16)
    value = (near[0][:, :, None] * forces[:, None, :]).reshape(count, 16)
    couplings, lateral = response.couplings[region, channel], response.lateral
    seen = [(couplings[:, 2 * j : 2 * j + 2] * unit).sum(axis=1) for j in range(lateral)]
    seen += [couplings[:, j] for j in range(2 * lateral, couplings.shape[1])]
    each = response.profiles[0].size
    values = np.concatenate([value * along[:, None] for along in seen], axis=1)
    columns = np.concatenate([column + j * each for j in range(len(seen))], axis=1)
    starts = np.arange(count + 1) * values.shape[1]
    shape = (count, response.profiles.size)
    return scipy.sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=shape)
