"""The order of a plan: the gel recovers between presses at the same place, and travel stays short."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactile_nodes.collection.plan.plan import Plan, PlanSettings, Point

FAR_MM = 1e6
AHEAD = 2.0  # penalty for each press that a place had already, in units of `rest_mm`


def ordered(plan: Plan, settings: PlanSettings) -> tuple[Point, ...]:
    """The plan's points in the order in which they are done; always the same for the same plan.

    The next press is at the nearest place that is at least `rest_mm` away from the last `rest_presses` presses. A place
    that has had more presses than others counts as farther away, so that the last presses of a plan do not crowd in one
    corner. The order of the depths at a place is random, seeded by the plan's hash. If no place keeps that distance,
    the one that has recovered longest comes next.

    A spread plan keeps its own order, in which any first part covers the gel; only presses too near the last ones are
    postponed.
    """
    in_turn = settings.kind == 'spread'
    stacks = [[point] for point in plan.points] if in_turn else _by_place(plan)
    places = np.array([stack[0][1:3] for stack in stacks], np.float64)
    rest_mm = settings.rest_mm if settings.rest_presses else 0.0
    walk = _walk(places, [len(stack) for stack in stacks], rest_mm, settings.rest_presses, in_turn=in_turn)
    return tuple(stacks[place].pop() for place in walk)


def _by_place(plan: Plan) -> list[list[Point]]:
    found: dict[tuple[float, float], list[Point]] = {}
    for point in sorted(plan.points, key=lambda point: _mixed(plan, point)):
        found.setdefault(point[1:3], []).append(point)
    return [stack for _, stack in sorted(found.items())]


def _walk(
    places: npt.NDArray[np.float64], counts: Sequence[int], rest_mm: float, rest_presses: int, *, in_turn: bool
) -> Sequence[int]:
    """Indices of places, each as often as its count: the nearest next, or the lowest index if `in_turn`."""
    left, visits = np.array(counts), np.zeros(len(places))
    free_from = np.zeros(len(places), np.int64)  # the step from which a place has recovered
    walk = [0]
    for step in range(1, sum(counts) + 1):
        current = walk[-1]
        distances_mm = np.sqrt(((places - places[current]) ** 2).sum(axis=1))
        left[current] -= 1
        visits[current] += 1
        free_from[distances_mm < rest_mm] = step + rest_presses
        if step < sum(counts):
            cost = np.arange(len(places), dtype=np.float64) if in_turn else distances_mm + AHEAD * rest_mm * visits
            walk.append(_next(cost, left, free_from, step))
    return walk


def _next(
    cost: npt.NDArray[np.float64], left: npt.NDArray[np.int64], free_from: npt.NDArray[np.int64], step: int
) -> int:
    rested = np.where((left > 0) & (free_from <= step), cost, np.inf)
    best = int(np.argmin(rested))
    if np.isfinite(rested[best]):
        return best
    return int(np.argmin(np.where(left > 0, free_from * FAR_MM + cost, np.inf)))


def _mixed(plan: Plan, point: Point) -> bytes:
    return hashlib.sha256(f'{plan.plan_id} {point.press}'.encode('ascii')).digest()
