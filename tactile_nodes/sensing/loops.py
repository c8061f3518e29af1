"""Inner loops compiled by numba: the arithmetic of the numpy code beside which they stand, several times as fast.

Signatures are given, so importing this module compiles everything, or loads what an earlier process compiled; nothing
is compiled while frames come. Sums are made in another order than numpy's, so last digits differ.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import inspect

import numpy as np
from numba import njit

_MATH = {'reassoc', 'contract', 'nsz', 'arcp'}
"""Sums may be reordered; NaN and infinity keep their meaning."""


def _compiled(signature: str | None = None):
    """With a signature compiled here, or loaded; the parts without one are compiled into these.

    Tests wrap every function of this package to check its arguments, which numba cannot read: it gets the inner one.
    """
    compiler = njit(signature, cache=signature is not None, fastmath=_MATH, error_model='numpy', nogil=True)
    return lambda function: compiler(inspect.unwrap(function))


@_compiled()
def _sums(image, left, top, side, basis):
    """Dot products of a window with its three templates, and its contrast: the sum of squares about the mean."""
    total, square = np.int64(0), np.int64(0)
    a, b, c = np.float32(0), np.float32(0), np.float32(0)
    for row in range(side):
        line, begin = image[top + row, left : left + side], row * side
        one, two, three = basis[0, begin : begin + side], basis[1, begin : begin + side], basis[2, begin : begin + side]
        grey, squared = np.int32(0), np.int32(0)
        for column in range(side):
            whole, value = np.int32(line[column]), np.float32(line[column])
            grey += whole
            squared += whole * whole
            a += one[column] * value
            b += two[column] * value
            c += three[column] * value
        total += grey
        square += squared
    return a, b, c, np.float32(square - total * total / (side * side))


@_compiled(
    'void(u1[:, ::1], i4[:, ::1], i8[::1], i8, f4[:, :, ::1], f4[:, :, ::1], f4[:, :, ::1], f4[::1], f4[:, ::1], '
    'f4[::1])'
)
def match(image, corner, numbers, side, basis, unmix, mend, limits, motion, explained):
    """Patches `numbers` read at `corner`: fills in their motion (2, some) and the share of them that is explained.

    As `Templates.find`, whose `basis`, `unmix` and `mend` these are; `limits`: least gain and largest answer.
    """
    least_gain, largest, one = limits[0], limits[1], np.float32(1)
    terms = np.empty(9, np.float32)
    for i in range(numbers.shape[0]):
        p = numbers[i]
        a, b, c, contrast = _sums(image, corner[0, i], corner[1, i], side, basis[p])
        explained[i] = (a * a + b * b + c * c) / max(contrast, one)
        gain = max(unmix[0, 0, p] * a + unmix[0, 1, p] * b + unmix[0, 2, p] * c, least_gain)
        x = (unmix[1, 0, p] * a + unmix[1, 1, p] * b + unmix[1, 2, p] * c) / gain
        y = (unmix[2, 0, p] * a + unmix[2, 1, p] * b + unmix[2, 2, p] * c) / gain
        x, y = min(max(x, -largest), largest), min(max(y, -largest), largest)
        terms[0], terms[1], terms[2], terms[3], terms[4] = x, y, x * x, x * y, y * y
        terms[5], terms[6], terms[7], terms[8] = x * x * x, x * x * y, x * y * y, y * y * y
        for k in range(9):
            x += mend[0, k, p] * terms[k]
            y += mend[1, k, p] * terms[k]
        motion[0, i], motion[1, i] = x, y


@_compiled()
def _weights(value, axis, both):
    """Number of the first of four cubic splines at a value, and their values and slopes; see `SplineAxis.weights`."""
    low, high, intervals = axis[0], axis[1], axis[2]
    per_unit = intervals / (high - low)
    along = (min(max(value, low), high) - low) * per_unit
    first = min(int(along), int(intervals) - 1)
    t = along - first
    u = 1 - t
    both[0, 0], both[0, 3] = u * u * u / 6, t * t * t / 6
    both[0, 1], both[0, 2] = (4 - 6 * t * t + 3 * t * t * t) / 6, (4 - 6 * u * u + 3 * u * u * u) / 6
    both[1, 0], both[1, 3] = -u * u / 2 * per_unit, t * t / 2 * per_unit
    both[1, 1], both[1, 2] = (-4 * t + 3 * t * t) / 2 * per_unit, (4 * u - 3 * u * u) / 2 * per_unit
    return first


@_compiled()
def _value_and_slopes(at, axes, coefficients, result):
    """As `splines.value_and_slopes`: fills in (4, outputs)."""
    x, y, s = np.empty((2, 4)), np.empty((2, 4)), np.empty((2, 4))
    i, j, k = _weights(at[0], axes[0], x), _weights(at[1], axes[1], y), _weights(at[2], axes[2], s)
    result[:] = 0
    outputs = coefficients.shape[3]
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


@_compiled()
def _solve(matrix, right):
    """A small positive definite system, in place: Cholesky without the roots."""
    n = right.shape[0]
    for j in range(n):
        for k in range(j):
            share = matrix[j, k] * matrix[k, k]
            for i in range(j, n):
                matrix[i, j] -= matrix[i, k] * share
        for i in range(j + 1, n):
            matrix[i, j] /= matrix[j, j]
    for j in range(n):
        for k in range(j):
            right[j] -= matrix[j, k] * right[k]
    for j in range(n - 1, -1, -1):
        right[j] /= matrix[j, j]
        for k in range(j + 1, n):
            right[j] -= matrix[k, j] * right[k]


@_compiled()
def _compare(components, contacts, axes, coefficients, growth, information, down):
    """How well contacts explain the components (mean squared misfit); fills in information and the way down."""
    count, outputs = contacts.shape[0], components.shape[0]
    made = np.empty((count, 4, outputs), np.float32)
    left = components.astype(np.float64)
    strongest = 0.0
    for n in range(count):
        _value_and_slopes(contacts[n], axes, coefficients, made[n])
        strongest = max(strongest, contacts[n, 2])
        for c in range(outputs):
            left[c] -= made[n, 0, c]
    certainty = np.empty(outputs)
    height = strongest / axes[2, 1]
    misfit = 0.0
    for c in range(outputs):
        certainty[c] = 1 / (1 + growth[c] * height * height)
        misfit += left[c] * left[c] * certainty[c]
    for i in range(3 * count):
        one = made[i // 3, 1 + i % 3]
        along = 0.0
        for c in range(outputs):
            along += one[c] * certainty[c] * left[c]
        down[i] = along
        for j in range(i + 1):
            other = made[j // 3, 1 + j % 3]
            both = 0.0
            for c in range(outputs):
                both += np.float64(one[c]) * other[c] * certainty[c]
            information[i, j] = both
            information[j, i] = both
    return misfit / outputs


@_compiled()
def _of_nothing(components, growth, height):
    """The mean squared misfit of no contact, in the variance of a contact of that height."""
    misfit = 0.0
    for c in range(components.shape[0]):
        misfit += components[c] * components[c] / (1 + growth[c] * height * height)
    return misfit / components.shape[0]


@_compiled(
    'f8(f4[::1], f8[:, ::1], f8[:, ::1], f4[:, :, :, ::1], f4[::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1])'
)
def locate(components, begin, axes, coefficients, growth, limits, ends, contacts, information):
    """As `response.locate`: fills in contacts (n, 3) and information (3 n, 3 n), and returns the misfit.

    `axes` are low, high and intervals of x, y and s; `limits` the damping, largest step, lowest and highest value along
    each; `ends` the step at which steps end, how many they may be, the gain that is worth a step, and the least gain.
    """
    n, outputs = begin.shape[0], components.shape[0]
    here, down = begin.copy(), np.empty(3 * n)
    now, system = np.empty((3 * n, 3 * n)), np.empty((3 * n, 3 * n))
    best = np.inf
    for step in range(int(ends[1])):
        misfit = _compare(components, here, axes, coefficients, growth, now, down)
        before = best
        if step == 0 or misfit < best:
            best = misfit
            contacts[:] = here
            information[:] = now
        if step > 0 and before - best < 2 * ends[2] / outputs:
            strongest = 0.0
            for i in range(n):
                strongest = max(strongest, contacts[i, 2])
            nothing = _of_nothing(components, growth, strongest / axes[2, 1])
            if (nothing - best) * outputs / 2 < ends[3]:
                break
        system[:] = now
        for i in range(3 * n):
            system[i, i] += limits[0, i % 3]
        _solve(system, down)
        furthest = 0.0
        for i in range(3 * n):
            axis = i % 3
            moved = here[i // 3, axis] + min(max(down[i], -limits[1, axis]), limits[1, axis])
            moved = min(max(moved, limits[2, axis]), limits[3, axis])
            furthest = max(furthest, abs(moved - here[i // 3, axis]))
            here[i // 3, axis] = moved
        if furthest < ends[0]:
            break
    return best


@_compiled()
def _along(force, k, weights, profiles, result):
    """Profiles over distance at a force: fills in (2, profiles, distances), values and slopes along the force."""
    for p in range(profiles.shape[0]):
        for d in range(profiles.shape[1]):
            value, slope = 0.0, 0.0
            for f in range(4):
                value += profiles[p, d, k + f] * weights[0, f]
                slope += profiles[p, d, k + f] * weights[1, f]
            result[0, p, d] = value * force
            result[1, p, d] = value + slope * force


@_compiled()
def _seen_along(couplings, columns, slopes, made, made_slopes):
    """What one region shows of its columns and of their three slopes."""
    for channel in range(2):
        total, by_x, by_y, by_force = 0.0, 0.0, 0.0, 0.0
        for c in range(columns.shape[0]):
            share = couplings[channel, c]
            total += share * columns[c]
            by_x += share * slopes[0, c]
            by_y += share * slopes[1, c]
            by_force += share * slopes[2, c]
        made[channel] = total
        made_slopes[0, channel], made_slopes[1, channel], made_slopes[2, channel] = by_x, by_y, by_force


@_compiled()
def _columns(value, outward, by_force, toward, core, distance, numbers, columns, slopes):
    """Columns of one region and their slopes; as `AxisymmetricResponse.columns_and_slopes`."""
    lateral, width = int(numbers[0]), numbers[2]
    inner = (1 - core * core) / numbers[5]
    for p in range(value.shape[0]):
        if p < lateral:
            along, across = outward[p] * core + value[p] * inner, value[p] * core / distance
            for channel in range(2):
                c = 2 * p + channel
                columns[c] = value[p] * toward[channel] * core
                slopes[2, c] = by_force[p] * toward[channel] * core
                for axis in range(2):
                    product = toward[axis] * toward[channel]
                    same = 1.0 if axis == channel else 0.0
                    slopes[axis, c] = (along * product + across * (same - product)) / width
        else:
            c = lateral + p
            columns[c] = value[p]
            slopes[2, c] = by_force[p]
            slopes[0, c], slopes[1, c] = outward[p] * toward[0] / width, outward[p] * toward[1] / width


@_compiled(
    'void(f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1], f8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, :, ::1])'
)
def motion_and_slopes(contacts, places, couplings, profiles, numbers, axes, made, slopes):
    """As `AxisymmetricResponse.motion_and_slopes`: fills in (n, regions, 2) and (3, n, regions, 2).

    `numbers` are how many profiles are lateral, the hardest force, width, softness, bend, core and the least distance;
    `axes` low, high and intervals of the splines over distance and force.
    """
    hardest, width, softness, bend, least = numbers[1], numbers[2], numbers[3], numbers[4], numbers[6]
    count = profiles.shape[0]
    along = np.empty((2, count, profiles.shape[1]))
    weights, near, toward = np.empty((2, 4)), np.empty((2, 4)), np.empty(2)
    value, outward, by_force = np.empty(count), np.empty(count), np.empty(count)
    columns, column_slopes = np.empty(couplings.shape[2]), np.empty((3, couplings.shape[2]))
    region_slopes = np.empty((3, 2))
    for n in range(contacts.shape[0]):
        force = contacts[n, 2] * softness
        k = _weights(force, axes[1], weights)
        if force >= hardest:
            weights[1, :] = 0.0
        _along(force, k, weights, profiles, along)
        for r in range(places.shape[0]):
            x, y = (contacts[n, 0] - places[r, 0]) / width, (contacts[n, 1] - places[r, 1]) / width
            distance = np.sqrt(x * x + y * y + least * least)
            toward[0], toward[1] = x / distance, y / distance
            i = _weights(np.arcsinh(distance / bend), axes[0], near)
            per_mm = 1 / np.sqrt(distance * distance + bend * bend)
            for p in range(count):
                here, out, more = 0.0, 0.0, 0.0
                for j in range(4):
                    here += along[0, p, i + j] * near[0, j]
                    out += along[0, p, i + j] * near[1, j]
                    more += along[1, p, i + j] * near[0, j]
                value[p], outward[p], by_force[p] = here, out * per_mm, more * softness
            core = np.tanh(distance / numbers[5])
            _columns(value, outward, by_force, toward, core, distance, numbers, columns, column_slopes)
            _seen_along(couplings[r], columns, column_slopes, made[n, r], region_slopes)
            for axis in range(3):
                slopes[axis, n, r, 0], slopes[axis, n, r, 1] = region_slopes[axis, 0], region_slopes[axis, 1]
