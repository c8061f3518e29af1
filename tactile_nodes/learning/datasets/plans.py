"""Places of simulated presses: anywhere, spread far apart, on the paper's grid, a coarser grid, or near its places."""

from __future__ import annotations

import numpy as np

from tactile_nodes.collection.plan.plan import CANDIDATES, PlanSettings, make_plan
from tactile_nodes.learning.config import DataConfig
from tactile_nodes.shapes import Float, Int
from tactile_nodes.simulation.optics import Press

PLACES, PITCH_MM = 37, 0.75
DEPTHS, DEPTH_STEP_MM = 8, 0.25
COARSE_STEP = 4
"""The coarse plan has every fourth of the paper's places along x and along y: 10 x 10, 3 mm apart."""
NO_CONTACT_MM = -1.0
"""The depth that marks a frame without contact."""


def press_count(data: DataConfig) -> int:
    """Number of frames of a plan, with those without contact.

    Without those, the paper's has at most 10952 presses, the coarse 800, a spread one 2000.
    """
    if data.plan == 'random':
        return data.presses
    presses = min(data.presses, CANDIDATES if data.plan == 'spread' else len(_places_mm(data)) ** 2 * DEPTHS)
    return presses + round(presses * data.without_contact / (1 - data.without_contact))


def planned_presses(data: DataConfig, block: int, first: int, count: int) -> list[Press]:
    """`count` presses of the plan, starting at number `first`. Random plans have a seed for every block."""
    if data.plan == 'random':
        return random_presses(data, block, count)
    plan = spread_plan(data) if data.plan == 'spread' else grid_plan(data)
    return [Press(*each) for each in plan[first : first + count].tolist()]


def random_presses(data: DataConfig, block: int, count: int) -> list[Press]:
    """Places and depths, uniform within the configuration's limits. Some presses are without contact."""
    random = np.random.default_rng([data.seed, block])
    x, y = random.uniform(-data.reach_mm, data.reach_mm, (2, count))
    depth = random.uniform(min(data.shallowest_mm, data.deepest_mm), max(data.shallowest_mm, data.deepest_mm), count)
    depth[random.random(count) < data.without_contact] = NO_CONTACT_MM
    return [Press(*each) for each in zip(x.tolist(), y.tolist(), depth.tolist(), strict=True)]


def grid_plan(data: DataConfig) -> Float[np.ndarray, 'frames 3']:
    """x, y and depth (mm) of a grid's presses in random order, so that any first part covers the gel.

    A frame without contact comes before a press, at its place.
    """
    random = np.random.default_rng([data.seed, 0])
    along, depths = _places_mm(data), np.arange(1, DEPTHS + 1) * DEPTH_STEP_MM
    presses = np.stack(np.meshgrid(along, along, depths, indexing='ij'), axis=-1).reshape(-1, 3)
    if data.plan == 'jittered':
        presses += random.uniform(-0.5, 0.5, presses.shape) * (PITCH_MM, PITCH_MM, DEPTH_STEP_MM)
    presses = presses[random.permutation(len(presses))][: data.presses]
    return _with_untouched(presses, press_count(data) - len(presses), random)


def spread_plan(data: DataConfig) -> Float[np.ndarray, 'frames 3']:
    """x, y and depth (mm) of presses as in a calibration. Frames without contact are placed as in a grid."""
    settings = PlanSettings(
        kind='spread',
        count=min(data.presses, CANDIDATES),
        reach_mm=data.reach_mm,
        depths_mm=(max(0.001, data.shallowest_mm), data.deepest_mm),  # a plan has whole micrometres, and no 0
        seed=data.seed,
    )
    presses = np.array([point[1:] for point in make_plan(settings).points])
    return _with_untouched(presses, press_count(data) - len(presses), np.random.default_rng([data.seed, 0]))


def _places_mm(data: DataConfig) -> Float[np.ndarray, ' places']:
    """The places of a grid along one axis, -13.5 to 13.5 mm."""
    places: np.ndarray = (np.arange(PLACES) - (PLACES - 1) / 2) * PITCH_MM
    return places[::COARSE_STEP] if data.plan == 'coarse' else places


def _with_untouched(
    presses: Float[np.ndarray, 'presses 3'], count: int, random: np.random.Generator
) -> Float[np.ndarray, 'frames 3']:
    before = np.sort(random.integers(0, len(presses), count))
    untouched = presses[before] * (1, 1, 0) + (0, 0, NO_CONTACT_MM)
    return np.insert(presses, before, untouched, axis=0)


def press_numbers(depth_mm: Float[np.ndarray, ' frames']) -> Int[np.ndarray, ' frames']:
    """A number for each press of a plan. A frame without contact (a depth below 0) has the number of the next press."""
    touched = depth_mm >= 0
    numbers: np.ndarray = np.cumsum(touched) - touched
    return numbers
