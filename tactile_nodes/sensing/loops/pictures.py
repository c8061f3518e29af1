"""Checks of whole pictures, compiled: see `picture.motion.MotionFit` and `quality`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, factorise, substitute
from tactile_nodes.sensing.picture.motion import TERMS

_PICTURE = "Array(u1, 2, 'C', True)"


@compiled()
def _weighted(motion, weight, along_x, along_y, normal, terms):
    """As `MotionFit._weighted`: fills in terms."""
    normal[:] = 0.0
    terms[:] = 0.0
    for p in range(weight.shape[0]):
        for i in range(TERMS):
            x, y = weight[p] * along_x[p, i], weight[p] * along_y[p, i]
            terms[i] += x * motion[p, 0] + y * motion[p, 1]
            for j in range(TERMS):
                normal[i, j] += x * along_x[p, j] + y * along_y[p, j]
    added = 1e-6 * normal[0, 0] + 1e-30
    for i in range(TERMS):
        normal[i, i] += added
    factorise(normal)
    substitute(normal, terms)


@compiled('void(f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], i8, f8, f8, f8[::1])')
def common(motion, weight, along_x, along_y, rounds, least, scale, terms):
    """As the rounds of `MotionFit.common`, starting at `terms` and the squared distance `scale`."""
    normal, now = np.empty((TERMS, TERMS)), np.empty(weight.shape[0])
    for _ in range(rounds):
        for p in range(weight.shape[0]):
            x, y = motion[p, 0], motion[p, 1]
            for i in range(TERMS):
                x -= along_x[p, i] * terms[i]
                y -= along_y[p, i] * terms[i]
            share = 1 + (x * x + y * y) / scale
            now[p] = weight[p] / (share * share)
        _weighted(motion, now, along_x, along_y, normal, terms)
        scale = max(least, scale / 4)


@compiled(f'void({_PICTURE}, u1[:, ::1])')
def halved(image, small):
    """As `flow.patches.shrunk`, once: fills in a picture of half the size."""
    two = np.uint16(2)
    for row in range(small.shape[0]):
        one, other, means = image[2 * row], image[2 * row + 1], small[row]
        for i in range(means.shape[0]):
            left, right = np.uint16(one[2 * i]), np.uint16(one[2 * i + 1])
            means[i] = (left + right + np.uint16(other[2 * i]) + np.uint16(other[2 * i + 1]) + two) >> two


@compiled(f'UniTuple(i8, 3)({_PICTURE}, i8, i8)')
def counted(image, every, dark):
    """Sum of every n-th pixel of every n-th row, and how many of these are at least `dark`, and 255."""
    total, bright, burnt = 0, 0, 0
    for row in range(0, image.shape[0], every):
        for column in range(0, image.shape[1], every):
            value = np.int64(image[row, column])
            total += value
            bright += value >= dark
            burnt += value == 255
    return total, bright, burnt


@compiled(f'UniTuple(f8, 2)({_PICTURE}, i8, i8)')
def differences(image, first, every):
    """Mean difference of adjacent pixels, and of pixels three apart, in every n-th row."""
    width, rows, near, far = image.shape[1], 0, 0, 0
    for row in range(first, image.shape[0], every):
        line = image[row]
        rows += 1
        beside, apart = np.int32(0), np.int32(0)
        for i in range(width - 1):
            beside = np.int32(beside + abs(np.int32(line[i + 1]) - np.int32(line[i])))
        for i in range(width - 3):
            apart = np.int32(apart + abs(np.int32(line[i + 3]) - np.int32(line[i])))
        near += np.int64(beside)
        far += np.int64(apart)
    return near / (rows * (width - 1)), far / (rows * (width - 3))
