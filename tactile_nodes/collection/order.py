"""In which order a plan is done: the gel rests where it was pressed, and the way from press to press stays short."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactile_nodes.collection.plan import Plan, PlanSettings, Point

FAR = 1e9  # mm: done


def ordered(plan: Plan, settings: PlanSettings) -> tuple[Point, ...]:
    """The plan's points from the first to do to the last; the same for the same plan, whenever it is asked.

    The next press is always the nearest one to the last that keeps `rest_mm` away from the last `rest_presses`
    presses; among the depths of one place chance decides, by the plan's own hash. Where nothing keeps that
    distance, at the end of a plan, the press whose neighbours were left alone for longest comes next.
    """
    return tuple(plan.points[index] for index in _order(plan, settings.rest_mm, settings.rest_presses))


def _order(plan: Plan, rest_mm: float, rest_presses: int) -> Sequence[int]:
    shuffled = sorted(range(len(plan.points)), key=lambda index: _mixed(plan, index))
    places = np.array([plan.points[index][1:3] for index in shuffled])
    left = np.zeros(len(places))  # FAR once done
    recent: deque[int] = deque(maxlen=max(1, rest_presses))
    found = [int(np.argmin(np.hypot(*(places - places.min(axis=0)).T)))]
    while True:
        left[found[-1]] = FAR
        recent.append(found[-1])
        if len(found) == len(places):
            return [shuffled[index] for index in found]
        found.append(_next(places, left, recent, rest_mm if rest_presses else 0.0))


def _next(places: npt.NDArray[np.float64], left: npt.NDArray[np.float64], recent: deque[int], rest_mm: float) -> int:
    away = np.hypot(*(places - places[recent[-1]]).T)
    crowded = np.zeros(len(places), bool)
    oldest_touch = np.full(len(places), -1)
    for age, index in enumerate(recent):
        near = np.hypot(*(places - places[index]).T) < rest_mm
        crowded |= near
        oldest_touch[near] = age
    cost = away + left
    free = np.where(crowded, 2 * FAR, cost)
    best = int(np.argmin(free))
    if free[best] < FAR:
        return best
    return int(np.argmin(np.where(left >= FAR, 2 * FAR, oldest_touch * 1e3 + away)))


def _mixed(plan: Plan, index: int) -> bytes:
    return hashlib.sha256(f'{plan.plan_id} {index}'.encode('ascii')).digest()


def travel_mm(points: Sequence[Point]) -> float:
    """The way over the gel from the first point to the last: (0, 0), (3, 4), (3, 5) are 6 mm."""
    return sum(math.dist(a[1:3], b[1:3]) for a, b in pairwise(points))


def least_rest(points: Sequence[Point], rest_mm: float) -> int:
    """The least number of presses between two that are nearer than `rest_mm` to each other."""
    places = np.array([point[1:3] for point in points])
    for gap in range(1, len(points)):
        if (np.hypot(*(places[gap:] - places[:-gap]).T) < rest_mm).any():
            return gap - 1
    return len(points)
