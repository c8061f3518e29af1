"""From a frame's features to contacts and forces by a measured response, in one compiled call.

The arithmetic is that of `measured.readout.ResponseReadout.read`, which explains it. Here it is written in loops.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.loops.common import (
    compiled,
    copy,
    factor_at,
    factorise,
    finite,
    spread_over_bins,
    substitute,
    variances,
)
from tactile_nodes.sensing.loops.scores import observed, whitened
from tactile_nodes.sensing.loops.shape import noise_without, shapes, value_and_slopes


@compiled()
def _compare(components, contacts, axes, coefficients, growth, information, descent):
    """Mean squared misfit of the components for given contacts. Fills in information and the descent direction."""
    count, outputs = contacts.shape[0], components.shape[0]
    modelled = np.empty((count, 4, outputs), np.float32)
    left = np.empty(outputs)
    for c in range(outputs):
        left[c] = components[c]
    strongest = 0.0
    for n in range(count):
        value_and_slopes(contacts[n], axes, coefficients, modelled[n])
        strongest = max(strongest, contacts[n, 2])
        for c in range(outputs):
            left[c] -= modelled[n, 0, c]
    certainty = np.empty(outputs)
    height = strongest / axes[2, 1]
    misfit = 0.0
    for c in range(outputs):
        certainty[c] = 1 / (1 + growth[c] * height * height)
        misfit += left[c] * left[c] * certainty[c]
    for i in range(3 * count):
        one = modelled[i // 3, 1 + i % 3]
        along = 0.0
        for c in range(outputs):
            along += one[c] * certainty[c] * left[c]
        descent[i] = along
        for j in range(i + 1):
            other = modelled[j // 3, 1 + j % 3]
            both = 0.0
            for c in range(outputs):
                both += np.float64(one[c]) * other[c] * certainty[c]
            information[i, j] = both
            information[j, i] = both
    return misfit / outputs


@compiled()
def _gained(components, growth, contacts, misfit, highest):
    """As `response.gained`."""
    height = 0.0
    for n in range(contacts.shape[0]):
        height = max(height, contacts[n, 2] / highest)
    nothing = 0.0
    for c in range(components.shape[0]):
        nothing += components[c] * components[c] / (1 + growth[c] * height * height)
    return (nothing - misfit * components.shape[0]) / 2


@compiled()
def _locate(components, begin, axes, coefficients, growth, limits, ends, contacts, information):
    """As `response.locate`: fills in contacts (n, 3) and information (3 n, 3 n), and returns the misfit.

    `axes` are low, high and intervals of x, y and s. `limits` are the damping, largest step, lowest and highest value
    along each. `ends` are the final step size, most steps, the gain that is worth a step, and the least gain.
    """
    n, outputs = begin.shape[0], components.shape[0]
    current, descent = np.empty((n, 3)), np.empty(3 * n)
    copy(begin, current)
    now, system = np.empty((3 * n, 3 * n)), np.empty((3 * n, 3 * n))
    best = np.inf
    for step in range(int(ends[1])):
        misfit = _compare(components, current, axes, coefficients, growth, now, descent)
        before = best
        if step == 0 or misfit < best:
            best = misfit
            copy(current, contacts)
            copy(now, information)
        hardly = step > 0 and before - best < 2 * ends[2] / outputs
        if hardly and _gained(components, growth, contacts, best, axes[2, 1]) < ends[3]:
            break
        copy(now, system)
        for i in range(3 * n):
            system[i, i] += limits[0, i % 3]
        factorise(system)
        substitute(system, descent)
        furthest = 0.0
        for i in range(3 * n):
            axis = i % 3
            moved = current[i // 3, axis] + min(max(descent[i], -limits[1, axis]), limits[1, axis])
            moved = min(max(moved, limits[2, axis]), limits[3, axis])
            furthest = max(furthest, abs(moved - current[i // 3, axis]))
            current[i // 3, axis] = moved
        if furthest < ends[0]:
            break
    return best


@compiled()
def _start(components, table, levels, begin):
    """As `Response.start`: fills in the closest entry of the table.

    The table holds contacts (starts, 3), the components that they cause (components, starts) in units, and the squares.
    """
    starts, fields, unit, norms = table
    along = np.zeros(norms.shape[0], np.float32)
    for c in range(components.shape[0]):
        value, row = components[c] * unit[c], fields[c]
        for i in range(along.shape[0]):
            along[i] += value * np.float32(row[i])
    best, least, best_share = 0, np.float32(np.inf), np.float32(1)
    for i in range(along.shape[0]):
        share = np.float32(1)
        if i % levels == 0:
            share = min(max(along[i] / max(norms[i], np.float32(1e-9)), np.float32(0)), np.float32(1))
        away = share * (share * norms[i] - 2 * along[i])
        if away < least:
            best, least, best_share = i, away, share
    begin[0], begin[1], begin[2] = starts[best, 0], starts[best, 1], starts[best, 2] * best_share


@compiled()
def _one_more(components, contacts, response, table, ends, levels, more, information):
    """Add one contact where the residual is largest. Fills in contacts and information, and returns the misfit."""
    axes, coefficients, growth, limits = response
    count = contacts.shape[0]
    begin, left = np.empty((count + 1, 3)), np.empty_like(components)
    modelled = np.empty((4, components.shape[0]), np.float32)
    copy(contacts, begin[:count])
    for c in range(left.shape[0]):
        left[c] = components[c]
    for n in range(count):
        value_and_slopes(contacts[n], axes, coefficients, modelled)
        for c in range(left.shape[0]):
            left[c] -= modelled[0, c]
    _start(left, table, levels, begin[count])
    now = np.array((ends[0], ends[1], ends[2], 0.0 if count else ends[3]))
    return _locate(components, begin, axes, coefficients, growth, limits, now, more, information)


@compiled()
def _fit(components, response, table, ends, levels, limit, most):
    """As `ResponseReadout.fit`: contacts (n, 3), information (3 n, 3 n), and the misfit."""
    contacts, information = np.empty((1, 3)), np.empty((3, 3))
    misfit = _one_more(components, np.empty((0, 3)), response, table, ends, levels, contacts, information)
    while misfit > limit and contacts.shape[0] < most:
        count = contacts.shape[0] + 1
        more, more_information = np.empty((count, 3)), np.empty((3 * count, 3 * count))
        found = _one_more(components, contacts, response, table, ends, levels, more, more_information)
        if found > 0.5 * misfit:
            break
        contacts, information, misfit = more, more_information, found
    return contacts, information, misfit


@compiled()
def _stay_at_ends(contacts, limits, converged, moved):
    """As `response.at_an_end`: whether any contact is at an end. Such contacts stay there."""
    any_does = False
    for n in range(contacts.shape[0]):
        does = False
        for axis in range(3):
            does = does or contacts[n, axis] >= limits[3, axis] - converged
            does = does or (axis < 2 and contacts[n, axis] <= limits[2, axis] + converged)
        if does:
            copy(contacts[n : n + 1], moved[n : n + 1])
        any_does = any_does or does
    return any_does


@compiled()
def _near_ends(contacts, axes, hard):
    """As `Response.near_ends`: whether any contact is near an end."""
    for n in range(contacts.shape[0]):
        rim = 0.0
        for axis in range(2):
            low, high, place = axes[axis, 0], axes[axis, 1], contacts[n, axis]
            step = (high - low) / axes[axis, 2]
            rim += max(max(low + step - place, place - (high - step)) / step, 0.0)
        if rim > 0 and contacts[n, 2] >= hard * (1 - rim):
            return True
    return False


@compiled()
def _tell(contacts, doubt, information, limits, highest, nowhere, floors, factors, rows):
    """As `ResponseReadout.contacts`: fills in rows of x, y, force, sigma of place and of force, strongest first."""
    count = contacts.shape[0]
    spread = np.empty((count, 3))
    variances(information, limits[0], spread)
    for n in range(count):
        row = 0  # how many are stronger
        for other in range(count):
            harder = contacts[other, 2] - contacts[n, 2]
            row += harder > 0 or (harder == 0 and other < n)
        x, y, s = contacts[n, 0], contacts[n, 1], contacts[n, 2]
        of_x, of_y, of_s = spread[n, 0], spread[n, 1], spread[n, 2]
        rows[row, 0], rows[row, 1], rows[row, 2] = x, y, max(s, 0.0)
        fitted = math.sqrt((of_x + of_y) / 2)
        sigma_mm = factor_at(factors[0], s / highest) * math.hypot(floors[0], fitted)
        sigma_n = factor_at(factors[1], s / highest) * math.hypot(floors[1], math.sqrt(of_s))
        rows[row, 3] = min(math.hypot(sigma_mm, math.sqrt((doubt[n, 0] + doubt[n, 1]) / 2)), nowhere)
        rows[row, 4] = math.hypot(sigma_n, math.sqrt(doubt[n, 2]))


@compiled(
    "Tuple((i8, f8, f8))(Array(f4, 1, 'C', True), Array(f4, 1, 'C', True), UniTuple(f4[::1], 3), f4[:, ::1], "
    'f4[:, ::1], Tuple((f8[:, ::1], f4[:, :, :, ::1], f4[::1], f8[:, ::1])), '
    'Tuple((f8[:, ::1], i2[:, ::1], f4[::1], f4[::1])), UniTuple(f8[::1], 2), f8[::1], '
    'f8[:, ::1], UniTuple(f8, 21), f8[:, ::1], f4[:, ::1])'
)
def read(
    values,
    confidence,
    scaling,
    directions,
    whitening,
    response,
    table,
    factors,
    ends,
    shifts,
    numbers,
    contacts,
    forces,
):
    """As `ResponseReadout.read`: fills in contacts (most, 5) and forces on bins.

    Returns the number of contacts, the standard deviation of the total, and the novelty. Without enough regions there
    is no contact. A contact is a row of x, y, force, and the standard deviations of place and force.
    """
    floor, sure, levels, limit, likeness, share, place_floor, force_floor, nowhere, beyond = numbers[:10]
    axes, growth, limits = response[0], response[2], response[3]
    scores, components = np.empty(directions.shape[0], np.float32), np.empty(directions.shape[0], np.float32)
    left_over, size = observed(values, confidence, scaling, directions, floor, sure, scores)
    if not finite(size, scores):
        return 0, math.nan, math.nan
    whitened(whitening, scores, components)
    found, information, misfit = _fit(components, response, table, ends, int(levels), limit * limit, contacts.shape[0])
    count, corrected, floors = found.shape[0], found, (place_floor, force_floor)
    unlike = max(math.sqrt(misfit) / limit, left_over / (likeness + share * size))
    noise = noise_without(0.0, misfit, numbers[18], components.shape[0])
    touching = _gained(components, growth, found, misfit, axes[2, 1]) >= ends[3] * noise
    doubt = np.zeros((count, 3))
    if touching:
        corrected = np.empty_like(found)
        shapes(components, found, information, misfit, response, shifts, numbers[13:], corrected, doubt)
        at_end = _stay_at_ends(found, limits, ends[0], corrected)
        if at_end or _near_ends(found, axes, numbers[12]):
            unlike = max(unlike, beyond)
    _tell(corrected, doubt, information, limits, axes[2, 1], nowhere, floors, factors, contacts)
    if not touching:
        count = 1
        contacts[0, 2], contacts[0, 3] = 0.0, nowhere
    total = 0.0
    for n in range(count):
        total += contacts[n, 4] * contacts[n, 4]
    spread_over_bins(contacts, count, numbers[10:12], forces)
    return count, math.sqrt(total), unlike
