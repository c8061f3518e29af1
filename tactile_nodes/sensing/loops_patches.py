"""Patches of a rest image found in a frame, compiled: see `fixed_reference_patches.Templates`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.loops_common import compiled


@compiled()
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


@compiled(
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
