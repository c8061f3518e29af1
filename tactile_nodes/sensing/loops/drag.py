"""A contact that drags the skin, in loops: see `contact_drag`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, factorise, substitute
from tactile_nodes.sensing.loops.width import laplacian, value_and_slopes, value_of

AMOUNTS = 5


@compiled()
def _shares(pull_x, pull_y, shares):
    """As `contact_drag.amounts` and `amounts_slopes`: fills in a row of the amounts and two of their slopes."""
    shares[0, 0], shares[0, 1] = pull_x, pull_y
    shares[0, 2], shares[0, 3] = pull_x * pull_x - pull_y * pull_y, 2 * pull_x * pull_y
    shares[0, 4] = pull_x * pull_x + pull_y * pull_y
    shares[1, 0], shares[1, 1], shares[2, 0], shares[2, 1] = 1.0, 0.0, 0.0, 1.0
    shares[1, 2], shares[1, 3], shares[1, 4] = 2 * pull_x, 2 * pull_y, 2 * pull_x
    shares[2, 2], shares[2, 3], shares[2, 4] = -2 * pull_y, 2 * pull_x, 2 * pull_y


@compiled()
def _slopes(here, response, drag, slopes):
    """Fills in what here is made (row 0), and its slopes along x, y, s, width and drag."""
    axes, coefficients = response[0], response[1]
    outputs = slopes.shape[1]
    made, bend = np.empty((4, outputs), np.float32), np.empty(outputs, np.float32)
    parts, shares = np.empty((4, drag[1].shape[3]), np.float32), np.empty((3, AMOUNTS))
    value_and_slopes(here, axes, coefficients, made)
    laplacian(here, axes, coefficients, bend)
    value_and_slopes(here, drag[0], drag[1], parts)
    _shares(here[4], here[5], shares)
    for c in range(outputs):
        for part in range(4):
            total = np.float64(made[part, c])
            for a in range(AMOUNTS):
                total += shares[0, a] * parts[part, a * outputs + c]
            slopes[part, c] = total
        slopes[4, c] = bend[c]
        slopes[0, c] += here[3] * bend[c]
        for way in range(2):
            total = 0.0
            for a in range(AMOUNTS):
                total += shares[1 + way, a] * parts[0, a * outputs + c]
            slopes[5 + way, c] = total


@compiled()
def _asked_slopes(here, response, drag, slopes):
    """The same where nothing is wide or drags yet."""
    axes, coefficients = response[0], response[1]
    outputs = slopes.shape[1]
    made, bend = np.empty((4, outputs), np.float32), np.empty(outputs, np.float32)
    short = np.empty(2 * outputs, np.float32)
    value_and_slopes(here, axes, coefficients, made)
    laplacian(here, axes, coefficients, bend)
    value_of(here, drag[0], drag[1], short)
    for c in range(outputs):
        for part in range(4):
            slopes[part, c] = made[part, c]
        slopes[4, c] = bend[c]
        slopes[5, c], slopes[6, c] = short[c], short[outputs + c]


@compiled()
def _sums(components, here, response, granted, slopes, information, down):
    """Fills in information and the way down of slopes; returns misfit and cost."""
    growth, high = response[2], response[0][2, 1]
    outputs = components.shape[0]
    left, certainty = np.empty(outputs), np.empty(outputs)
    squares = 0.0
    height = here[2] / high
    for c in range(outputs):
        certainty[c] = 1 / (1 + growth[c] * height * height)
        left[c] = components[c] - slopes[0, c]
        squares += left[c] * left[c] * certainty[c]
    cost = squares
    for i in range(6):
        along = 0.0
        for c in range(outputs):
            along += slopes[i + 1, c] * certainty[c] * left[c]
        down[i] = along
        for j in range(i + 1):
            both = granted[i] if i == j else 0.0
            for c in range(outputs):
                both += slopes[i + 1, c] * slopes[j + 1, c] * certainty[c]
            information[i, j] = both
            information[j, i] = both
        if i >= 3:
            down[i] -= granted[i] * here[i]
            cost += granted[i] * here[i] * here[i]
    return squares / outputs, cost


@compiled()
def _solved(information, down, count, step):
    """Fills in the step by the first `count` numbers; returns how far down it leads."""
    system = np.empty((count, count))
    for i in range(count):
        step[i] = down[i]
        for j in range(count):
            system[i, j] = information[i, j]
    factorise(system)
    substitute(system, step[:count])
    along = 0.0
    for i in range(count):
        along += down[i] * step[i]
    return along


@compiled()
def _gained(components, here, astray, response, drag, slopes, information, down):
    """As `contact_drag.gained_by_drag`; `astray` where the fit leaves more over than it may."""
    numbers, step, one = drag[2], np.empty(6), np.zeros(6)
    _asked_slopes(here, response, drag, slopes)
    _sums(components, here, response, numbers[13:19], slopes, information, down)
    without = _solved(information, down, 4, step)
    gain = (_solved(information, down, 6, step) - without) / 2
    one[3] = 1.0
    width = step[3]
    variance = _solved(information, one, 6, step)
    wide = 0.0 if astray else max(abs(width) - numbers[6] * math.sqrt(variance), 0.0) / numbers[5]
    return gain / (1 + wide * wide)


@compiled()
def _of_place(information, limits, known):
    """Information on x, y and s alone, without what a step is granted, from that on all six."""
    system, column, spread = np.empty((6, 6)), np.empty(6), np.empty((3, 3))
    for i in range(6):
        for j in range(6):
            system[i, j] = information[i, j]
    factorise(system)
    for i in range(3):
        for j in range(6):
            column[j] = 1.0 if i == j else 0.0
        substitute(system, column)
        for j in range(3):
            spread[i, j] = column[j]
    factorise(spread)
    for i in range(3):
        for j in range(3):
            column[j] = 1.0 if i == j else 0.0
        substitute(spread, column[:3])
        for j in range(3):
            known[i, j] = column[j]
        known[i, i] -= limits[0, i]


@compiled()
def dragged(components, contact, astray, response, drag, converged, found, known):
    """As `contact_drag.dragged`: fills in x, y, s, width and drag, and the information on x, y and s.

    Returns the misfit, infinite where the contact may well be one that was pressed straight down.
    """
    limits, numbers = response[3], drag[2]
    slopes, information, down = np.empty((7, components.shape[0])), np.empty((6, 6)), np.empty(6)
    here, step, kept = np.zeros(6), np.empty(6), np.empty((6, 6))
    here[0], here[1], here[2] = contact[0], contact[1], contact[2]
    if _gained(components, here, astray, response, drag, slopes, information, down) < numbers[0]:
        return np.inf
    least, best = np.inf, np.inf
    for _ in range(int(numbers[4])):
        _slopes(here, response, drag, slopes)
        misfit, cost = _sums(components, here, response, numbers[7:13], slopes, information, down)
        _solved(information, down, 6, step)
        if cost < least:
            least, best = cost, misfit
            for i in range(6):
                found[i] = here[i]
                for j in range(6):
                    kept[i, j] = information[i, j]
        furthest = 0.0
        for i in range(6):
            moved = here[i] + step[i]
            if i < 3:
                moved = here[i] + min(max(step[i], -limits[1, i]), limits[1, i])
                moved = min(max(moved, limits[2, i]), limits[3, i])
            elif i > 3:
                moved = here[i] + min(max(step[i], -numbers[3]), numbers[3])
            if i != 3:
                furthest = max(furthest, abs(moved - here[i]))
            here[i] = moved
        if furthest < converged:
            break
    _of_place(kept, limits, known)
    return best


@compiled()
def beside_drag(found, drag, near, beyond, at_end):
    """As `ResponseReadout._beside_drag`: how unlike the training it is at least, and the square of what N are off."""
    length = math.hypot(found[4], found[5])
    off = drag[2][2] * length
    return beyond if at_end or length > drag[2][1] else near, off * off
