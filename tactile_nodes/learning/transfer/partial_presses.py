"""Presses of which something is not known: the force under a pen held by hand, or the place of a known weight.

What is unknown is found along with how the gel differs as a whole: steps of Levenberg and Marquardt in the numbers of
`tactile_nodes.learning.transfer.whole` and in each press's own unknowns at once. The latter are eliminated press by
press (Schur complement), so many presses cost little more than few.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from tactile_nodes.learning.axisymmetric.regions import FIRST_DOUBT, Presses
from tactile_nodes.learning.transfer.whole import SIZES, WholeFit, changed
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse

MOST_STEPS, FURTHER_STEPS = 25, 6
"""Steps of a fit, and of one that begins with a fit to nearly the same presses."""
CONVERGED = 1e-4
"""Share of the cost: steps end where none gains more."""
STEP = 1e-3
DOUBT = 0.15
"""Of each region's motion: what a gel whose markers lie elsewhere is expected to show differently."""
FIRST_DAMPING, LAST_DAMPING = 1e-3, 1e6
LARGEST_STEP = np.array([1.5, 1.5, 0.15])
"""Of what is unknown of a press: mm, mm, N."""
UNIT = np.array([1.0, 1.0, 0.1])
"""How far an unknown of a press may move where the damping is 1: mm, mm, N."""
MARGIN = 1.2
"""How much harder than the hardest known press a pen may press."""
LOCATING_STEPS = 15
START_SPACING_MM = 2.0
START_FORCES = np.array([0.1, 0.3, 0.6, 0.9])
"""Of the hardest press."""
REACH = 1.15
"""Of what the model knows: how far out a weight is looked for."""


def unknown(presses: Presses) -> Bool[np.ndarray, 'n 3']:
    """What is not known of each press: x, y, force."""
    return np.asarray(np.isnan(presses.contacts))


def at(presses: Presses, contacts: Float[np.ndarray, 'n 3']) -> Presses:
    """The same motion, seen of other contacts."""
    return replace(presses, contacts=contacts)


def located(
    response: AxisymmetricResponse,
    presses: Presses,
    reach_mm: float,
    *,
    begin: Float[np.ndarray, 'n 3'] | None = None,
) -> Float[np.ndarray, 'n 3']:
    """The contacts with what is unknown of them as this response explains their motion best.

    Args:
        response: of the gel, as far as it is known.
        presses: NaN where something is unknown of a contact.
        reach_mm: how far from the middle weights may lie.
        begin: contacts to begin with; the best of a table without.
    """
    free = unknown(presses)
    here = _table_starts(response, presses, reach_mm) if begin is None else begin.copy()
    if not free.any():
        return here
    for _ in range(LOCATING_STEPS):
        known = at(presses, here)
        weight = known.weights(response, FIRST_DOUBT)
        made, slopes = response.motion_and_slopes(here)
        lever = _per_press(slopes * weight, free)
        left = ((presses.motion - made) * weight).reshape(len(here), -1)
        square, down = lever @ lever.transpose(0, 2, 1), np.matmul(lever, left[..., None])[..., 0]
        square[:, np.arange(3), np.arange(3)] += 1e-6 + 1e-4 * square[:, np.arange(3), np.arange(3)] + ~free
        moved = _moved(here, np.linalg.solve(square, down[..., None])[..., 0], response, reach_mm)
        done = bool((np.abs(moved - here) < 1e-4).all())
        here = moved
        if done:
            break
    return here


def _per_press(slopes: Float[np.ndarray, '3 n regions 2'], free: Bool[np.ndarray, 'n 3']) -> np.ndarray:
    """Slopes along what is unknown of each press, 0 along the rest: (n, 3, regions * 2)."""
    return np.asarray(slopes.transpose(1, 0, 2, 3).reshape(len(free), 3, -1) * free[..., None])


def _moved(
    here: np.ndarray, step: np.ndarray, response: AxisymmetricResponse, reach_mm: float
) -> Float[np.ndarray, 'n 3']:
    high = np.array([REACH * reach_mm, REACH * reach_mm, MARGIN * response.highest_n])
    low = np.array([-high[0], -high[1], 0.005])
    step = np.where(step == 0, 0, np.clip(step, -LARGEST_STEP, LARGEST_STEP))
    return np.asarray(np.where(step == 0, here, np.clip(here + step, low, high)))


def _table_starts(response: AxisymmetricResponse, presses: Presses, reach_mm: float) -> Float[np.ndarray, 'n 3']:
    """For each press the contact of a coarse table that explains it best, what is known of it held."""
    forces = START_FORCES * response.highest_n
    along = np.arange(-reach_mm, reach_mm + START_SPACING_MM, START_SPACING_MM)
    begun, weight = presses.contacts.copy(), np.sqrt(_certainty(presses))
    for number, contact in enumerate(presses.contacts):
        axes = [
            each if np.isnan(value) else np.array([value])
            for each, value in zip((along, along, forces), contact.tolist(), strict=True)
        ]
        table = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
        if len(table) > 1:
            left = (presses.motion[number] - response.motion(table)) * weight[number]
            begun[number] = table[int(np.square(left).sum(axis=(1, 2)).argmin())]
    return np.asarray(begun)


def _certainty(presses: Presses) -> Float[np.ndarray, 'n regions 2']:
    """One over the variance of each motion: its noise, and a share of it."""
    size = np.square(presses.motion).sum(-1, keepdims=True)
    return np.asarray(presses.certainty / (1 + presses.certainty * DOUBT**2 * size))


@dataclass(frozen=True)
class PartialFit:
    """How a gel differs as a whole, and the contacts with what was unknown of them."""

    whole: WholeFit
    contacts: Float[np.ndarray, 'n 3']


@dataclass(frozen=True)
class _Here:
    """A point of the search: numbers, contacts, weighted residuals of each press, and the cost."""

    numbers: np.ndarray
    contacts: np.ndarray
    left: Float[np.ndarray, 'n values']
    cost: float


@dataclass(frozen=True)
class _Search:
    """What stays the same during a search."""

    start: AxisymmetricResponse
    presses: Presses
    reach_mm: float
    open_: np.ndarray
    prior: Float[np.ndarray, 'open open']
    weight: np.ndarray
    free: Bool[np.ndarray, 'n 3']

    def at(self, numbers: np.ndarray, contacts: np.ndarray) -> _Here:
        told = changed(self.start, numbers).motion(contacts)
        left = ((self.presses.motion - told) * self.weight).reshape(len(contacts), -1)
        held = numbers[self.open_]
        return _Here(numbers, contacts, left, float((left * left).sum() + held @ self.prior @ held))

    def levers(self, here: _Here) -> tuple[Float[np.ndarray, 'n open values'], Float[np.ndarray, 'n 3 values']]:
        """How what each press leaves over falls with the open numbers, and with its own unknowns."""
        units = np.eye(len(here.numbers))[self.open_]
        shared = [(here.left - self.at(here.numbers + STEP * unit, here.contacts).left) / STEP for unit in units]
        slopes = changed(self.start, here.numbers).motion_and_slopes(here.contacts)[1]
        return np.stack(shared, axis=1), _per_press(slopes * self.weight, self.free)

    def stepped(self, here: _Here, levers: tuple[np.ndarray, np.ndarray], damping: float) -> _Here:
        """One damped step of everything at once."""
        shared, own = levers
        left = here.left[..., None]
        square = np.einsum('npv,nqv->pq', shared, shared, optimize=True) + self.prior
        square += damping * np.diag(np.diag(square))
        down = (shared @ left)[..., 0].sum(axis=0) - self.prior @ here.numbers[self.open_]
        inner = own @ own.transpose(0, 2, 1)
        diagonal = np.arange(3)
        inner[:, diagonal, diagonal] += damping * inner[:, diagonal, diagonal] + 1e-3 / UNIT**2 + ~self.free
        cross, own_down = shared @ own.transpose(0, 2, 1), own @ left
        solved = np.linalg.solve(inner, np.concatenate([cross.transpose(0, 2, 1), own_down], axis=2))
        schur = square - (cross @ solved[..., :-1]).sum(axis=0)
        step = np.linalg.solve(schur, down - (cross @ solved[..., -1:])[..., 0].sum(axis=0))
        numbers = here.numbers.copy()
        numbers[self.open_] += step
        moved = _moved(
            here.contacts,
            np.where(self.free, solved[..., -1] - solved[..., :-1] @ step, 0.0),
            changed(self.start, numbers),
            self.reach_mm,
        )
        return self.at(numbers, moved)


def fit_partial(
    start: AxisymmetricResponse,
    presses: Presses,
    free: tuple[str, ...],
    reach_mm: float,
    *,
    begin: PartialFit | None = None,
    sizes: Mapping[str, float] | None = None,
) -> PartialFit:
    """The response, changed as a whole, that explains the presses best whatever their unknowns are.

    Args:
        start: the response to begin with, of an equal gel.
        presses: NaN where something is unknown of a contact.
        free: the numbers that may change.
        reach_mm: how far from the middle weights may lie.
        begin: numbers and contacts to begin with.
        sizes: how far from 0 each number may be expected to be, where that is not as in `SIZES`.
    """
    typical = {**SIZES, **(sizes or {})}
    open_ = np.array([number for number, name in enumerate(SIZES) if name in free], int)
    prior = np.diag([1 / typical[name] ** 2 for name in SIZES if name in free])
    numbers = np.zeros(len(SIZES)) if begin is None else begin.whole.numbers
    contacts = located(changed(start, numbers), presses, reach_mm) if begin is None else begin.contacts
    weight = np.sqrt(_certainty(presses))
    search = _Search(start, presses, reach_mm, open_, prior, weight, unknown(presses))
    found = _descend(search, search.at(numbers, contacts), FURTHER_STEPS if begin else MOST_STEPS)
    return PartialFit(WholeFit(changed(start, found.numbers), found.numbers), found.contacts)


def _descend(search: _Search, here: _Here, most_steps: int) -> _Here:
    damping = FIRST_DAMPING
    for _ in range(most_steps):
        levers = search.levers(here)
        tried = search.stepped(here, levers, damping)
        while tried.cost >= here.cost and damping < LAST_DAMPING:
            damping *= 10
            tried = search.stepped(here, levers, damping)
        if tried.cost >= here.cost:
            break
        gained, here = here.cost - tried.cost, tried
        damping = max(damping / 10, 1e-9)
        if gained < CONVERGED * here.cost:
            break
    return here
