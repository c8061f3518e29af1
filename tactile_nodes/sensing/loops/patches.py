"""Patches of a rest image found in a frame, compiled: see `flow.patches` and `flow.inverse_compositional`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.loops.common import compiled

_GREY = np.float32(128)
"""Subtracted from each pixel to keep sums small. Templates have zero mean, so the result does not change."""


@compiled()
def _read(image, left, top, side, pixels):
    """Read a window's pixels into contiguous memory, where sums take half the time."""
    rows, first_row, first_column = pixels.reshape(side, side), np.uintp(top), np.uintp(left)
    for row in range(np.uintp(side)):
        for column in range(np.uintp(side)):
            rows[row, column] = np.float32(image[first_row + row, first_column + column]) - _GREY


@compiled()
def _parts(pixels, one, two, three):
    """Dot products of a window with its three templates, and its contrast: the sum of squares about the mean."""
    a, b, c, total, square = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for i in range(pixels.shape[0]):
        value = pixels[i]
        a += np.float32(one[i]) * value
        b += np.float32(two[i]) * value
        c += np.float32(three[i]) * value
        total += value
        square += value * value
    return a, b, c, square - total * total / np.float32(pixels.shape[0])


@compiled()
def _find(image, left, top, side, templates, p, limits, pixels):
    """Motion of patch `p` relative to the window, and the explained share of the window."""
    basis, unit, unmix, mend = templates
    least_gain, largest = np.float32(limits[0]), np.float32(limits[1])
    _read(image, left, top, side, pixels)
    a, b, c, contrast = _parts(pixels, basis[p, 0], basis[p, 1], basis[p, 2])
    a, b, c = a * unit[p, 0], b * unit[p, 1], c * unit[p, 2]
    gain = max(unmix[0, 0, p] * a + unmix[0, 1, p] * b + unmix[0, 2, p] * c, least_gain)
    x = (unmix[1, 0, p] * a + unmix[1, 1, p] * b + unmix[1, 2, p] * c) / gain
    y = (unmix[2, 0, p] * a + unmix[2, 1, p] * b + unmix[2, 2, p] * c) / gain
    x, y = min(max(x, -largest), largest), min(max(y, -largest), largest)
    terms = (x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y)
    for k in range(9):
        x += mend[0, k, p] * terms[k]
        y += mend[1, k, p] * terms[k]
    return x, y, (a * a + b * b + c * c) / max(contrast, np.float32(1))


_TEMPLATES = 'Tuple((i2[:, :, ::1], f4[:, ::1], f4[:, :, ::1], f4[:, :, ::1]))'


@compiled(f"void(Array(u1, 2, 'C', True), i4[:, ::1], i8[::1], i8, {_TEMPLATES}, UniTuple(f8, 4), f4[:, ::1], f4[::1])")
def match(image, corner, numbers, side, templates, limits, motion, explained):
    """Measure the patches `numbers` at `corner`: fills in their motion (2, some) and their explained share.

    As `Templates.find`, with the same templates.
    """
    pixels = np.empty(side * side, np.float32)
    for i in range(numbers.shape[0]):
        found = _find(image, corner[0, i], corner[1, i], side, templates, numbers[i], limits, pixels)
        motion[0, i], motion[1, i], explained[i] = found


@compiled()
def _settle(image, home, p, side, templates, limits, readings, pixels):
    """Find a patch at home, and read it again at the place found."""
    height, width = image.shape
    again = np.float32(limits[2])
    x, y, explained = _find(image, home[0, p], home[1, p], side, templates, p, limits, pixels)
    at_x, at_y = np.float32(0), np.float32(0)
    for _ in range(readings - 1):
        if max(abs(x - at_x), abs(y - at_y)) <= again:
            break
        at_x, at_y = np.rint(x), np.rint(y)
        left = min(max(home[0, p] + int(at_x), 0), width - side)
        top = min(max(home[1, p] + int(at_y), 0), height - side)
        x, y, explained = _find(image, left, top, side, templates, p, limits, pixels)
        x += np.float32(left - home[0, p])
        y += np.float32(top - home[1, p])
    return x, y, explained


@compiled()
def _neighbours(count):
    """Five places around each place. Those beyond the rim are mirrored at the outermost place without doubling it."""
    found = np.empty((count, 5), np.uintp)
    for at in range(count):
        for step in range(5):
            place = at + step - 2
            while place < 0 or place >= count:
                place = 0 if count == 1 else (-place if place < 0 else 2 * (count - 1) - place)
            found[at, step] = place
    return found


@compiled()
def _blurred(known, weights):
    """Sums over five neighbours along both axes of (rows, cols, 3)."""
    rows, cols = known.shape[:2]
    above, beside = _neighbours(rows), _neighbours(cols)
    across, blurred = np.zeros_like(known), np.zeros_like(known)
    for row in range(rows):
        for col in range(cols):
            for step in range(5):
                for part in range(3):
                    across[row, col, part] += weights[step] * known[row, beside[col, step], part]
    for row in range(rows):
        for step in range(5):
            for col in range(cols):
                for part in range(3):
                    blurred[row, col, part] += weights[step] * across[above[row, step], col, part]
    return blurred


@compiled()
def _fill(motion, explained, known, weights, numbers, field, confidence):
    """As `flow.inverse_compositional.filled`, of all patches: fills in field (…, 2) and confidence (rows, cols)."""
    rows, cols = confidence.shape
    own, least, by = np.float32(numbers[0]), np.float32(numbers[1]), np.float32(numbers[2])
    measured = np.empty((rows, cols, 3), np.float32)
    for row in range(rows):
        for col in range(cols):
            p = row * cols + col
            share = min(max(explained[p], np.float32(0)), np.float32(1))
            sure = known[p] * share * share
            confidence[row, col] = measured[row, col, 2] = sure
            measured[row, col, 0], measured[row, col, 1] = sure * motion[0, p], sure * motion[1, p]
    around = _blurred(measured, weights)
    for row in range(rows):
        for col in range(cols):
            share, total = own / (around[row, col, 2] + least), measured[row, col, 2] + own
            for axis in range(2):
                blend = (measured[row, col, axis] + share * around[row, col, axis]) / total
                field[row, col, axis] = by * blend


@compiled(
    f"i8(Array(u1, 2, 'C', True), i4[:, ::1], i8, {_TEMPLATES}, UniTuple(f8, 4), i8, f4[::1], f4[::1], "
    'UniTuple(f8, 3), f4[:, ::1], f4[::1], f4[:, :, ::1], f4[:, ::1])'
)
def displacement(
    image, home, side, templates, limits, readings, known, weights, numbers, motion, explained, field, confidence
):
    """Find all patches: fills in motion (2, patches), their explained share, and the field and confidence from both.

    As `InverseCompositionalFlow.displacement`, except for lost patches: returns how many known patches are lost.

    Args:
        limits: least gain, largest motion, distance from which a patch is read again, and explained share below which
            it is lost. A patch is read at most `readings` times.
        known: how well each patch can be found, from its texture.
        weights, numbers: weights of the blur; weight of a patch's own measurement, least confidence around it, and
            image pixels per pixel at the patches' resolution.
        field, confidence: (rows, cols, 2) and (rows, cols).
    """
    pixels = np.empty(side * side, np.float32)
    lost = 0
    for p in range(home.shape[1]):
        found = _settle(image, home, p, side, templates, limits, readings, pixels)
        motion[0, p], motion[1, p], explained[p] = found
        if explained[p] < limits[3] and known[p] > 0.5:
            lost += 1
    _fill(motion, explained, known, weights, numbers, field, confidence)
    return lost
