"""Comparison of a frame with its rest image, compiled: see `stillness` and `touch_places`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, middle

_PICTURE = "Array(u1, 2, 'C', True)"


@compiled()
def _energies(image, rest, blocks, energy):
    """Sum of squared differences in each of blocks x blocks blocks of two pictures of equal size."""
    high, wide = image.shape[0] // blocks, image.shape[1] // blocks
    sums = np.empty(blocks * wide, np.int32)
    for i in range(blocks):
        for column in range(sums.shape[0]):
            sums[column] = 0
        for row in range(i * high, (i + 1) * high):
            one, other = image[row], rest[row]
            for column in range(sums.shape[0]):
                apart = np.int32(np.int32(one[column]) - np.int32(other[column]))
                sums[column] = np.int32(sums[column] + np.int32(apart * apart))
        for j in range(blocks):
            total = 0
            for column in range(j * wide, (j + 1) * wide):
                total += sums[column]
            energy[i * blocks + j] = total


@compiled()
def _change(image, rest, blocks, block, change):
    """Fill in the pixel differences of one block."""
    high, wide = image.shape[0] // blocks, image.shape[1] // blocks
    rows = change.reshape(high, wide)
    top, left = np.uintp(block // blocks * high), np.uintp(block % blocks * wide)
    for row in range(np.uintp(high)):
        one, other = image[top + row], rest[top + row]
        for column in range(np.uintp(wide)):
            rows[row, column] = np.float32(one[left + column]) - np.float32(other[left + column])


@compiled()
def _parts(change, known, unit):
    """Components of a change along four known parts."""
    a, b, c, d = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    one, two, three, four = known[0], known[1], known[2], known[3]
    for i in range(change.shape[0]):
        value = change[i]
        a += np.float32(one[i]) * value
        b += np.float32(two[i]) * value
        c += np.float32(three[i]) * value
        d += np.float32(four[i]) * value
    return a * unit[0], b * unit[1], c * unit[2], d * unit[3]


@compiled(
    f'Tuple((b1, f8, f8, f8))({_PICTURE}, {_PICTURE}, Tuple((i2[:, :, ::1], f4[:, ::1])), f4[::1], '
    'UniTuple(f8, 2), f4[:, ::1])'
)
def looked(image, rest, parts, light, plain, motion):
    """As `StillnessCheck._seen`: whether a closer check was needed, and its result.

    The result is the residual variance of the median block, the largest share of light (squared), and the largest
    residual variance over that of the median block. Fills in the motion of each block. Beyond the limits `plain` no
    closer check is needed.
    """
    known, unit = parts
    count = light.shape[0]
    blocks, energy = int(math.sqrt(count) + 0.5), np.empty(count, np.float32)
    _energies(image, rest, blocks, energy)
    most = plain[0] * middle(energy)
    for block in range(count):
        if energy[block] > most + plain[1] * light[block]:
            return False, 0.0, 0.0, 0.0
    change, share, largest = np.empty(known.shape[2], np.float32), 0.0, 0.0
    for block in range(count):
        _change(image, rest, blocks, block, change)
        a, b, c, d = _parts(change, known[block], unit[block])
        motion[block, 0], motion[block, 1] = c, d
        share = max(share, (a * a + b * b) / light[block])
        left = max(energy[block] - (a * a + b * b + c * c + d * d), np.float32(1e-6))
        energy[block] = left / np.float32(change.shape[0] - 4)
        largest = max(largest, energy[block])
    usual = middle(energy)
    return True, usual, share, largest / usual


@compiled('f8(f4[:, ::1], f4[:, :, ::1], f4[:, :, ::1], f4[:, :, ::1], f4[:, ::1])')
def most_away(motion, weight, rows, columns, scale):
    """As `TouchPlaces.most`."""
    count, places = weight.shape[0], scale.shape[0]
    sums = np.zeros((2, count, places), np.float32)
    for axis in range(2):
        for row in range(count):
            for column in range(count):
                value = motion[row * count + column, axis] * weight[row, column, axis]
                for place in range(places):
                    sums[axis, row, place] += value * columns[axis, column, place]
    most, line = np.float32(0), np.empty(places, np.float32)
    for above in range(places):
        for place in range(places):
            line[place] = 0
        for row in range(count):
            for place in range(places):
                line[place] += rows[0, above, row] * sums[0, row, place] + rows[1, above, row] * sums[1, row, place]
        for place in range(places):
            most = max(most, abs(line[place] * scale[above, place]))
    return most
