"""A response at a place, and whether contacts are tips pressed straight down: see `splines` and `contact_shape`."""

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
def _width(modelled, left, certainty, granted, column, step):
    """As `contact_shape._width`: fills in a step in x, y, s and width, and the last column of its covariance."""
    information = np.empty((4, 4))
    for i in range(4):
        one = modelled[i + 1]
        step[i] = 0.0
        column[i] = 1.0 if i == 3 else 0.0
        for c in range(left.shape[0]):
            step[i] += np.float64(one[c]) * left[c] * certainty[c]
        for j in range(i + 1):
            other = modelled[j + 1]
            both = granted[i] if i == j and i < 3 else 0.0
            for c in range(left.shape[0]):
                both += np.float64(one[c]) * other[c] * certainty[c]
            information[i, j] = both
            information[j, i] = both
    factorise(information)
    substitute(information, step)
    substitute(information, column)


@compiled()
def _step(step, column, contact, limits, usual, moved):
    """Fill in a contact corrected to the usual width, within the range of the splines."""
    share = step[3] / (column[3] + usual * usual)
    for i in range(3):
        by = min(max(step[i] - column[i] * share, -limits[1, i]), limits[1, i])
        moved[i] = min(max(contact[i] + by, limits[2, i]), limits[3, i])


@compiled()
def _dot(one, other, certainty):
    """Weighted sum of products."""
    total = 0.0
    for c in range(certainty.shape[0]):
        total += one[c] * certainty[c] * other[c]
    return total


@compiled()
def _shifted(modelled, shifts, left, certainty, information, limits, granted, by_shift):
    """As `contact_shape._shifted`: fills in the effect of a shift on x, y and s (n, 3), and returns its gain.

    `information` is that of all contacts.
    """
    count, channels = information.shape[0], shifts.shape[0]
    system, shared, by_contact = information.copy(), np.empty((channels, count)), np.empty((channels, count))
    descent, own = np.empty(channels), np.empty((channels, channels))
    for i in range(count):
        system[i, i] += limits[0, i % 3]
    factorise(system)
    for k in range(channels):
        for i in range(count):
            by_contact[k, i] = _dot(modelled[i // 3, 1 + i % 3], shifts[k], certainty)
            shared[k, i] = by_contact[k, i]
        substitute(system, shared[k])
    for k in range(channels):
        descent[k] = _dot(shifts[k], left, certainty)
        for i in range(count):
            descent[k] -= shared[k, i] * _dot(modelled[i // 3, 1 + i % 3], left, certainty)
        for m in range(channels):
            own[k, m] = _dot(shifts[k], shifts[m], certainty) + (granted if k == m else 0.0)
            for i in range(count):
                own[k, m] -= by_contact[k, i] * shared[m, i]
    step = descent.copy()
    factorise(own)
    substitute(own, step)
    gain = 0.0
    for k in range(channels):
        gain += descent[k] * step[k] / 2
    for i in range(count):
        by_shift[i // 3, i % 3] = 0.0
        for k in range(channels):
            by_shift[i // 3, i % 3] += shared[k, i] * step[k]
    return gain


@compiled()
def noise_without(explained, misfit, usual, count):
    """As `contact_shape.Residual.noise_without`."""
    return max(1.0, (misfit - explained / count) / usual)


@compiled()
def shapes(components, contacts, information, misfit, response, shifts, numbers, moved, doubt):
    """Fill in contacts corrected to the usual width (n, 3), and variances (n, 3) as `contact_shape.in_doubt`.

    `numbers` are the limits, and the share in doubt.
    """
    axes, coefficients, growth, limits = response
    most_gain, wide, sure, usual, granted, usual_misfit, per_mm2, of_shift = numbers
    count, outputs = contacts.shape[0], components.shape[0]
    modelled = np.empty((count, 5, outputs), np.float32)
    left, certainty = np.empty(outputs), np.empty(outputs)
    column, step = np.empty(4), np.empty(4)
    height = 0.0
    for n in range(count):
        height = max(height, contacts[n, 2] / axes[2, 1])
        value_and_slopes(contacts[n], axes, coefficients, modelled[n])
        laplacian(contacts[n], axes, coefficients, modelled[n, 4])
    for c in range(outputs):
        certainty[c] = 1 / (1 + growth[c] * height * height)
        left[c] = components[c]
        for n in range(count):
            left[c] -= modelled[n, 0, c]
    gain = _shifted(modelled, shifts, left, certainty, information, limits, granted, doubt)
    dragged = gain > most_gain * noise_without(2 * gain, misfit, usual_misfit, outputs)
    for n in range(count):
        for i in range(3):
            doubt[n, i] = (of_shift * doubt[n, i]) ** 2 if dragged else 0.0
        _width(modelled[n], left, certainty, limits[0], column, step)
        _step(step, column, contacts[n], limits, usual, moved[n])
        sigmas = step[3] / math.sqrt(column[3])
        noise = noise_without(sigmas * sigmas, misfit, usual_misfit, outputs)
        if step[3] >= wide and sigmas >= sure * math.sqrt(noise):
            doubt[n, 2] += (per_mm2 * step[3] * contacts[n, 2]) ** 2
