"""A response at a place, and how much wider than the training's a contact is: see `splines` and `contact_width`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, factorise, spline_weights, substitute


@compiled()
def value_and_slopes(at, axes, coefficients, result):
    """As `splines.value_and_slopes`: fills in (4, outputs)."""
    x, y, s = np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4))
    i, j, k = spline_weights(at[0], axes[0], x), spline_weights(at[1], axes[1], y), spline_weights(at[2], axes[2], s)
    outputs = coefficients.shape[3]
    for part in range(4):
        for c in range(outputs):
            result[part, c] = 0
    for m in range(4):
        for n in range(4):
            for o in range(4):
                row = coefficients[i + m, j + n, k + o]
                value, by_x = np.float32(x[0, m] * y[0, n] * s[0, o]), np.float32(x[1, m] * y[0, n] * s[0, o])
                by_y, by_s = np.float32(x[0, m] * y[1, n] * s[0, o]), np.float32(x[0, m] * y[0, n] * s[1, o])
                for c in range(outputs):
                    result[0, c] += value * row[c]
                    result[1, c] += by_x * row[c]
                    result[2, c] += by_y * row[c]
                    result[3, c] += by_s * row[c]


@compiled()
def value_of(at, axes, coefficients, result):
    """As `splines.value_of`, of as many outputs as the result has."""
    x, y, s = np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4))
    i, j, k = spline_weights(at[0], axes[0], x), spline_weights(at[1], axes[1], y), spline_weights(at[2], axes[2], s)
    for c in range(result.shape[0]):
        result[c] = 0
    for m in range(4):
        for n in range(4):
            for o in range(4):
                row, weight = coefficients[i + m, j + n, k + o], np.float32(x[0, m] * y[0, n] * s[0, o])
                for c in range(result.shape[0]):
                    result[c] += weight * row[c]


@compiled()
def _bends(value, axis, weights):
    """Second derivatives of the four cubic splines that are not zero at a value."""
    low, high, intervals = axis[0], axis[1], axis[2]
    per_unit = intervals / (high - low)
    along = (min(max(value, low), high) - low) * per_unit
    t = along - min(int(along), int(intervals) - 1)
    square = per_unit * per_unit
    weights[0], weights[3] = (1 - t) * square, t * square
    weights[1], weights[2] = (3 * t - 2) * square, (1 - 3 * t) * square


@compiled()
def laplacian(at, axes, coefficients, result):
    """As `splines.laplacian`: fills in outputs."""
    x, y, s = np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4))
    i, j, k = spline_weights(at[0], axes[0], x), spline_weights(at[1], axes[1], y), spline_weights(at[2], axes[2], s)
    of_x, of_y = np.empty(4), np.empty(4)
    _bends(at[0], axes[0], of_x)
    _bends(at[1], axes[1], of_y)
    for c in range(result.shape[0]):
        result[c] = 0
    for m in range(4):
        for n in range(4):
            for o in range(4):
                row = coefficients[i + m, j + n, k + o]
                weight = np.float32((of_x[m] * y[0, n] + x[0, m] * of_y[n]) * s[0, o])
                for c in range(result.shape[0]):
                    result[c] += weight * row[c]


@compiled()
def _added(made, left, certainty, granted, column, step):
    """As `contact_width._added`: fills in a step by x, y, s and width, and the last column of its covariance."""
    information = np.empty((4, 4))
    for i in range(4):
        one = made[i + 1]
        step[i] = 0.0
        column[i] = 1.0 if i == 3 else 0.0
        for c in range(left.shape[0]):
            step[i] += np.float64(one[c]) * left[c] * certainty[c]
        for j in range(i + 1):
            other = made[j + 1]
            both = granted[i] if i == j and i < 3 else 0.0
            for c in range(left.shape[0]):
                both += np.float64(one[c]) * other[c] * certainty[c]
            information[i, j] = both
            information[j, i] = both
    factorise(information)
    substitute(information, step)
    substitute(information, column)


@compiled()
def _taken(mm2, variance, height, numbers):
    """As `contact_width.taken`; `numbers` are `contact_width.WIDTHS`."""
    usual_mm2, any_mm2, most, below, left = numbers
    usual, whatever = variance + 4 * usual_mm2 * usual_mm2, variance + any_mm2 * any_mm2
    against = math.sqrt(whatever / usual) * math.exp(-mm2 * mm2 / 2 * (1 / usual - 1 / whatever))
    fading = min(max((left - height) / (left - below), 0.0), 1.0)
    return most * fading / (1 + against) if mm2 > 0 else 0.0


@compiled()
def off_by_width(components, contacts, response, power, numbers, moved):
    """Whether any contact is surely wider than the training's, and the square of what N forces are off by for that.

    Fills in contacts as they are with a usual width (n, 3); see `contact_width`. `numbers` are its limits.
    """
    axes, coefficients, growth, limits = response
    wide, sure, usual = numbers[:3]
    count, outputs = contacts.shape[0], components.shape[0]
    made = np.empty((count, 5, outputs), np.float32)
    left, certainty = np.empty(outputs), np.empty(outputs)
    column, step = np.empty(4), np.empty(4)
    height = 0.0
    for n in range(count):
        height = max(height, contacts[n, 2] / axes[2, 1])
        value_and_slopes(contacts[n], axes, coefficients, made[n])
        laplacian(contacts[n], axes, coefficients, made[n, 4])
    for c in range(outputs):
        certainty[c] = 1 / (1 + growth[c] * height * height)
        left[c] = components[c]
        for n in range(count):
            left[c] -= made[n, 0, c]
    surely, total = False, 0.0
    for n in range(count):
        _added(made[n], left, certainty, limits[0], column, step)
        share, s = step[3] / (column[3] + usual * usual), contacts[n, 2]
        by_s = step[2] - column[2] * share
        for i in range(2):
            by = min(max(step[i] - column[i] * share, -limits[1, i]), limits[1, i])
            moved[n, i] = min(max(contacts[n, i] + by, limits[2, i]), limits[3, i])
        off = min(max(step[2], -s), s) - min(max(by_s, -s), s)
        share_taken = _taken(step[3], column[3], s / axes[2, 1], numbers[2:])
        by = min(max(by_s + share_taken * off, -limits[1, 2]), limits[1, 2])
        moved[n, 2] = min(max(s + by, limits[2, 2]), limits[3, 2])
        if step[3] >= wide and step[3] >= sure * math.sqrt(column[3]):
            surely = True
            off *= (1 - share_taken) * max(s, 1e-9) ** (1 / power - 1) / power
            total += off * off
    return surely, total
