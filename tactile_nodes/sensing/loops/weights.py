"""Motion of the regions of a frame and their weights, compiled: see `FieldReadout.seen` and `field.weights`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.explain import noise
from tactile_nodes.sensing.explain.field import weights
from tactile_nodes.sensing.loops.common import compiled, finite, inverse_root


@compiled()
def _ordered(values, place):
    """The value at a place in sorted order, as a partition gives it (Hoare's find). Reorders the values."""
    low, high = 0, values.shape[0] - 1
    while low < high:
        pivot, i, j = values[place], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < place:
            low = i
        if place < i:
            high = j
    return values[place]


@compiled()
def _noise(moved, inside):
    """As `noise.noise_of`."""
    left, count = np.empty(2 * inside.size, np.float32), 0
    for row in range(1, inside.shape[0] - 1):
        for col in range(1, inside.shape[1] - 1):
            if not inside[row, col]:
                continue
            for part in range(2):
                total = np.float32(0)
                for y in range(3):
                    for x in range(3):
                        total += noise.CURVED[y, x] * moved[row + y - 1, col + x - 1, part]
                left[count] = abs(total)
                count += 1
    if count < noise.LEAST_DIFFERENCES:
        return 0.0
    return _ordered(left[:count], int(noise.QUIETEST * count)) / (noise.SIGMAS * noise.CURVED_TIMES)


@compiled()
def _certainties(motion, sure, noise_px, doubt, single):
    """As `weights.region_weights`: both axes of a region get the same weight."""
    regions = sure.shape[0]
    explained = np.empty(regions, np.float32)
    for r in range(regions):
        explained[r] = math.sqrt(sure[r])
    usual = max(_ordered(explained, min(int(weights.UNDISTURBED * regions), regions - 1)), np.float32(1e-6))
    for r in range(regions):
        left = weights.UNEXPLAINED_PX * min(max(1 - math.sqrt(sure[r]) / usual, 0.0), 1.0)
        found = (sure[r] - weights.LOST) / (weights.CERTAIN - weights.LOST)
        found = min(max(found, weights.LEAST_WEIGHT), 1.0)
        squared = motion[r, 0] * motion[r, 0] + motion[r, 1] * motion[r, 1]
        single[2 * r] = single[2 * r + 1] = found * found / (noise_px**2 + left * left + doubt * doubt * squared)


@compiled()
def _share(camera, single, shared):
    """As `Weights.of`."""
    rows, ways = camera.shape
    products, root = np.zeros((ways, ways)), np.zeros((ways, ways))
    for r in range(rows):
        for i in range(ways):
            for j in range(i + 1):
                products[i, j] += single[r] * camera[r, i] * camera[r, j]
    for i in range(ways):
        products[i, i] += 1.0
    inverse_root(products, root)
    for r in range(rows):
        for i in range(ways):
            total = 0.0
            for j in range(i + 1):
                total += root[i, j] * camera[r, j]
            shared[r, i] = single[r] * total


@compiled(
    "Tuple((i8, f8))(Array(f4, 3, 'C', True), Array(f4, 2, 'C', True), f4[:, :, ::1], i8[::1], b1[:, ::1], "
    'f8[:, ::1], UniTuple(f8, 3), f8[:, ::1], f4[::1], f4[:, ::1])'
)
def weighed(values, confidence, mean, known, inside, camera, numbers, motion, single, shared):
    """As `FieldReadout.seen`: the number of followed regions (0 if motion is not finite), and the noise (px).

    Args:
        values, confidence: values and confidence of all regions.
        mean: values at rest.
        known, inside: regions that are known, and those with all their neighbours known.
        camera: motion of the known regions as the camera moves.
        numbers: least confidence of a followed region, least noise (px), relative error of the response.
        motion, single, shared: outputs for the known regions.
    """
    floor, usual_px, doubt = numbers
    rows, cols = confidence.shape
    moved, sure, followed = np.empty_like(mean), np.empty(known.shape[0], np.float32), 0
    for row in range(rows):
        for col in range(cols):
            for part in range(2):
                moved[row, col, part] = values[row, col, part] - mean[row, col, part]
    for r in range(known.shape[0]):
        row, col = known[r] // cols, known[r] % cols
        sure[r], motion[r, 0], motion[r, 1] = confidence[row, col], moved[row, col, 0], moved[row, col, 1]
        followed += sure[r] >= floor
        if not finite(motion[r, 0], motion[r, 1:]):
            return 0, 0.0
    noise_px, doubled = _noise(moved, inside), np.empty(single.shape[0])
    _certainties(motion, sure, max(noise_px, usual_px), doubt, doubled)
    _share(camera, doubled, shared)
    for r in range(single.shape[0]):
        single[r] = doubled[r]
    return followed, noise_px
