"""Shared parts of the compiled loops: compilation, splines at a value, and small systems of equations.

numba caches compiled code by the file of the loop with a signature, and does not check other files compiled into it.
So cache entries older than the newest file of this folder are removed.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import contextlib
import inspect
import math
from pathlib import Path

import numpy as np
from numba import njit

_MATH = {'reassoc', 'contract', 'nsz', 'arcp'}
"""Sums may be reordered. NaN and infinity keep their meaning."""


def forget_older(folder: Path) -> None:
    """Remove numba's cache indices older than the newest source in a folder, so that it compiles again."""
    newest = max(each.stat().st_mtime_ns for each in folder.glob('*.py'))
    for index in (folder / '__pycache__').glob('*.nbi'):
        with contextlib.suppress(OSError):  # another process was first, or the folder is somebody else's
            if index.stat().st_mtime_ns < newest:
                index.unlink()


forget_older(Path(__file__).parent)


def compiled(signature: str | None = None):
    """Decorator: compile or load a function with a signature. Functions without one are compiled into their callers.

    Tests wrap every function of this package to check its arguments. numba cannot read the wrapper, so it gets the
    inner function.
    """
    compiler = njit(signature, cache=signature is not None, fastmath=_MATH, error_model='numpy', nogil=True)
    return lambda function: compiler(inspect.unwrap(function))


@compiled()
def spline_weights(value, axis, both):
    """Index of the first of four cubic splines at a value, and their values and slopes; see `SplineAxis.weights`."""
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


@compiled()
def copy(source, target):
    """Copy a two-dimensional array. numba would take seconds to compile an assignment of whole arrays."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = source[i, j]


@compiled()
def finite(number, numbers):
    """Whether all are finite numbers."""
    known = math.isfinite(number)
    for i in range(numbers.shape[0]):
        known = known and math.isfinite(numbers[i])
    return known


@compiled()
def middle(values):
    """The upper median of the values, as a partition of a copy would give it."""
    ordered = np.empty(values.shape[0], values.dtype)
    for i in range(values.shape[0]):
        value, at = values[i], i
        while at > 0 and ordered[at - 1] > value:
            ordered[at] = ordered[at - 1]
            at -= 1
        ordered[at] = value
    return ordered[values.shape[0] // 2]


@compiled()
def factorise(matrix):
    """Factorise a small positive definite matrix in place: Cholesky without square roots."""
    n = matrix.shape[0]
    for j in range(n):
        for k in range(j):
            share = matrix[j, k] * matrix[k, k]
            for i in range(j, n):
                matrix[i, j] -= matrix[i, k] * share
        for i in range(j + 1, n):
            matrix[i, j] /= matrix[j, j]


@compiled()
def substitute(matrix, right):
    """Solve for `right` in place, with a matrix factorised by `factorise`."""
    n = right.shape[0]
    for j in range(n):
        for k in range(j):
            right[j] -= matrix[j, k] * right[k]
    for j in range(n - 1, -1, -1):
        right[j] /= matrix[j, j]
        for k in range(j + 1, n):
            right[j] -= matrix[k, j] * right[k]


@compiled()
def _factorise_row(matrix, i, first):
    """Compute a row of a Cholesky factor from a column on, from the rows above. Returns whether it exists."""
    row = matrix[i]
    for j in range(first, i + 1):
        other, total = matrix[j], row[j]
        for k in range(j):
            total -= row[k] * other[k]
        if j < i:
            row[j] = total / other[j]
        elif total > 0:
            row[i] = math.sqrt(total)
        else:
            return False
    return True


@compiled()
def _factorise_rows(matrix):
    """Replace the lower half by a Cholesky factor: four rows and two columns at a time, with sums in registers."""
    n, none = matrix.shape[0], matrix.dtype.type(0)
    whole = n - n % 4
    for i in range(0, whole, 4):
        one, two, three, four = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
        for j in range(0, i, 2):
            left, right = matrix[j], matrix[j + 1]
            a, b, c, d, e, f, g, h = none, none, none, none, none, none, none, none
            for k in range(j):
                x, y = left[k], right[k]
                a, b, c, d = a + one[k] * x, b + one[k] * y, c + two[k] * x, d + two[k] * y
                e, f, g, h = e + three[k] * x, f + three[k] * y, g + four[k] * x, h + four[k] * y
            for row, x, y in ((one, a, b), (two, c, d), (three, e, f), (four, g, h)):
                row[j] = (row[j] - x) / left[j]
                row[j + 1] = (row[j + 1] - y - row[j] * right[j]) / right[j + 1]
        for row in range(i, i + 4):
            if not _factorise_row(matrix, row, i):
                return False
    able = True
    for row in range(whole, n):
        able = able and _factorise_row(matrix, row, 0)
    return able


@compiled()
def _invert_row(factor, root, i, first):
    """Compute a row of the inverse of a factor. The sums over rows before `first` are already present."""
    row, own = root[i], 1 / factor[i, i]
    for j in range(first, i):
        other, share = root[j], own * factor[i, j]
        for k in range(j + 1):
            row[k] -= share * other[k]
    row[i] = own


@compiled()
def inverse_root(matrix, root):
    """As `cone.inverse_root`. The matrix's lower half becomes its factor, `root` must be 0 at first. False: none."""
    n = matrix.shape[0]
    if not _factorise_rows(matrix):
        return False
    for i in range(0, n - 1, 2):
        one, two, above, below = root[i], root[i + 1], matrix[i], matrix[i + 1]
        for j in range(0, i, 2):  # two rows and two columns at a time
            left, right = root[j], root[j + 1]
            a, b, c, d = (
                above[j] / above[i],
                above[j + 1] / above[i],
                below[j] / below[i + 1],
                below[j + 1] / below[i + 1],
            )
            for k in range(j + 2):
                x, y = left[k], right[k]
                one[k] -= a * x + b * y
                two[k] -= c * x + d * y
        _invert_row(matrix, root, i, i)
        _invert_row(matrix, root, i + 1, i)
    if n % 2:
        _invert_row(matrix, root, n - 1, 0)
    return True


@compiled()
def variances(information, damping, spread):
    """As `response.Fit.variances`: the diagonal of the inverse of damped information, as (contacts, 3)."""
    n = information.shape[0]
    matrix, column = np.empty((n, n)), np.empty(n)
    copy(information, matrix)
    for i in range(n):
        matrix[i, i] += damping[i % 3]
    factorise(matrix)
    for i in range(n):
        for j in range(n):
            column[j] = 1.0 if i == j else 0.0
        substitute(matrix, column)
        spread[i // 3, i % 3] = column[i]


@compiled()
def factor_at(factors, height):
    """As `uncertainty.factor_at`."""
    last = factors.shape[0] - 1
    along = min(max(height, 0.0), 1.0) * last
    below = min(int(along), max(last - 1, 0))
    above = min(below + 1, last)
    return factors[below] + (along - below) * (factors[above] - factors[below])


@compiled()
def _shares(at, sigma, count, size, shares):
    """As `reading._shares`."""
    scale = max(sigma if np.isfinite(sigma) else 0.0, 1e-6) * math.sqrt(2)
    before = 0.0
    for i in range(count):
        below = 1.0 if i == count - 1 else 0.5 * (1 + math.erf((size * ((i + 1) / count - 0.5) - at) / scale))
        shares[i] = below - before
        before = below


@compiled()
def spread_over_bins(contacts, count, size_mm, forces):
    """As `reading.spread_over_bins`, for `count` rows of contacts: x, y, force, sigma of place and force."""
    rows, cols = forces.shape
    along_x, along_y = np.empty(cols), np.empty(rows)
    total = np.zeros((rows, cols))
    for n in range(count):
        _shares(contacts[n, 0], contacts[n, 3], cols, size_mm[0], along_x)
        _shares(contacts[n, 1], contacts[n, 3], rows, size_mm[1], along_y)
        for row in range(rows):
            for col in range(cols):
                total[row, col] += contacts[n, 2] * along_y[row] * along_x[col]
    copy(total, forces)
