"""The reported quantities of a force field, compiled: see `explain.field.sums`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.explain.field import contacts, where_now
from tactile_nodes.sensing.loops.common import compiled


@compiled()
def _further(surface, shear, row, col, shape):
    """Displacement of the surface along an axis under all shear along it, as summed by `cv2.filter2D`."""
    reach, total = surface.shape[0] // 2, 0.0
    for y in range(max(row - reach, 0), min(row + reach + 1, shape[0])):
        for x in range(max(col - reach, 0), min(col + reach + 1, shape[1])):
            total += surface[y - row + reach, x - col + reach] * shear[y * shape[1] + x]
    return total


@compiled()
def _between(place, count):
    """The first of the two lines around a place, and the distance beyond it; as `where_now._between`."""
    place = min(max(place, 0.0), count - 1.0)
    low = min(int(place), count - 2)
    return low, place - low


@compiled()
def _move(forces, surface, shape, size_mm, moved):
    """As `where_now.moved_along`."""
    for k in range(forces.shape[1]):
        if forces[0, k] == 0:
            continue
        row, col = k // shape[1], k % shape[1]
        right = where_now.HIDDEN / size_mm[0] * _further(surface[0], forces[1], row, col, shape)
        down = where_now.HIDDEN / size_mm[1] * _further(surface[1], forces[2], row, col, shape)
        y, below = _between(row + down, shape[0])
        x, beyond = _between(col + right, shape[1])
        for part in range(3):
            upper, lower = (1 - below) * forces[part, k], below * forces[part, k]
            moved[part, y * shape[1] + x] += (1 - beyond) * upper
            moved[part, y * shape[1] + x + 1] += beyond * upper
            moved[part, (y + 1) * shape[1] + x] += (1 - beyond) * lower
            moved[part, (y + 1) * shape[1] + x + 1] += beyond * lower


@compiled()
def _wrench(forces, root, active, centres, wrench, fitted):
    """Total force and torque of the patches, and their covariance from the fit alone; see `PatchGrid.levers`."""
    for k in range(forces.shape[1]):
        _pull(forces[0, k], forces[1, k], forces[2, k], centres[k], wrench)
    n, each = active.shape[0], np.empty(6)
    for i in range(root.shape[0]):
        each[:] = 0.0
        for a in range(n):
            _pull(root[i, a], root[i, n + a], root[i, 2 * n + a], centres[active[a]], each)
        for j in range(6):
            for k in range(6):
                fitted[j, k] += each[j] * each[k]


@compiled()
def _pull(normal, along_x, along_y, at, wrench):
    """Add a force at a place to the wrench: into the gel, along x and along y."""
    wrench[0] += along_x
    wrench[1] += along_y
    wrench[2] -= normal
    wrench[3] -= at[1] * normal
    wrench[4] += at[0] * normal
    wrench[5] += at[0] * along_y - at[1] * along_x


@compiled()
def _on_bins(forces, root, active, bin_of, bins, fitted):
    """Sums over bins, and the errors of the normal forces from the fit alone."""
    for part in range(3):
        for k in range(forces.shape[1]):
            bins[part, bin_of[k]] += forces[part, k]
    each = np.zeros(bins.shape[1])
    for i in range(root.shape[0]):
        for a in range(active.shape[0]):
            each[bin_of[active[a]]] += root[i, a]
        for b in range(each.shape[0]):
            fitted[b] += each[b] * each[b]
            each[b] = 0.0
    for b in range(each.shape[0]):
        fitted[b] = math.sqrt(fitted[b])


@compiled()
def _parts(pressed, shape, part):
    """As `contacts.parts_of`: fills in the part number of each patch. Returns the count of numbers, some unused."""
    most, total_n, count = 0.0, 0.0, 0
    for value in pressed:
        most, total_n = max(most, value), total_n + value
    peaks, sums = np.zeros(pressed.shape[0] + 1), np.zeros(pressed.shape[0] + 1)
    part[:] = 0
    for k in np.argsort(-pressed, kind='mergesort'):
        if pressed[k] <= contacts.TOUCHED * most:
            break
        row, col, first = k // shape[1], k % shape[1], 0
        above, below, left, right = max(row - 1, 0), min(row + 2, shape[0]), max(col - 1, 0), min(col + 2, shape[1])
        for y in range(above, below):
            for x in range(left, right):
                beside = part[y * shape[1] + x]
                if beside > 0 and (first == 0 or beside < first):
                    first = beside
        if first == 0:
            count += 1
            first, peaks[count] = count, pressed[k]
        for y in range(above, below):
            for x in range(left, right):
                other = part[y * shape[1] + x]
                if other > first and (
                    pressed[k] >= contacts.VALLEY * peaks[other] or sums[other] < contacts.LEAST_SHARE * total_n
                ):
                    for i in range(pressed.shape[0]):
                        if part[i] == other:
                            part[i] = first
                    sums[first] += sums[other]
        part[k], sums[first] = first, sums[first] + pressed[k]
    return count


@compiled()
def _slip_share(forces, inside, most, numbers):
    """As `contacts.slip_share`, for the patches inside; `most` is the largest normal force."""
    friction, pressed, touched, count = np.empty(inside.shape[0]), np.empty(inside.shape[0]), 0.0, 0
    for k in inside:
        normal = forces[0, k]
        if normal > contacts.TOUCHED * most:
            at, size = count, math.sqrt(forces[1, k] * forces[1, k] + forces[2, k] * forces[2, k]) / normal
            while at > 0 and friction[at - 1] > size:
                friction[at], pressed[at] = friction[at - 1], pressed[at - 1]
                at -= 1
            friction[at], pressed[at], touched, count = size, normal, touched + normal, count + 1
    at, below = 0, pressed[0]
    while at < count - 1 and below < contacts.EXCEEDED * touched:
        at += 1
        below += pressed[at]
    if friction[at] < contacts.LEAST_FRICTION:
        return 0.0
    turning = numbers[5] / numbers[6] if numbers[6] > 0 else 0.0
    net = math.sqrt(numbers[3] ** 2 + numbers[4] ** 2 + turning**2)
    return min(1.0, net / (friction[at] * numbers[2]))


@compiled()
def _extent(forces, inside, centres, size_mm, most, numbers):
    """As `contacts._extent`."""
    count, x, y, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in inside:
        if forces[0, k] >= contacts.HALF * most:
            count, x, y = count + 1, x + centres[k, 0], y + centres[k, 1]
    x, y = x / count, y / count
    for k in inside:
        if forces[0, k] >= contacts.HALF * most:
            right, down = centres[k, 0] - x, centres[k, 1] - y
            xx, xy, yy = xx + right * right, xy + right * down, yy + down * down
    xx, xy, yy = 12 * xx / count + size_mm[0] ** 2, 12 * xy / count, 12 * yy / count + size_mm[1] ** 2
    mean, off = (xx + yy) / 2, math.sqrt((xx - yy) ** 2 / 4 + xy * xy)
    numbers[7] = count * size_mm[0] * size_mm[1]
    numbers[8], numbers[9] = math.sqrt(mean + off), math.sqrt(mean - off)
    numbers[10] = math.atan2(2 * xy, xx - yy) / 2


@compiled()
def _contact(forces, root, active, inside, centres, size_mm, numbers):
    """As `contacts.numbers_of`, for the patches inside."""
    total, x, y, shear_x, shear_y, torsion, spread, most = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in inside:
        total, most = total + forces[0, k], max(most, forces[0, k])
        x, y = x + forces[0, k] * centres[k, 0], y + forces[0, k] * centres[k, 1]
        shear_x, shear_y = shear_x + forces[1, k], shear_y + forces[2, k]
    x, y, within = x / total, y / total, np.zeros(centres.shape[0], np.bool_)
    for k in inside:
        within[k], right, down = True, centres[k, 0] - x, centres[k, 1] - y
        torsion += right * forces[2, k] - down * forces[1, k]
        spread += forces[0, k] * (right * right + down * down)
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = x, y, total, shear_x, shear_y
    numbers[5], numbers[6] = torsion, math.sqrt(spread / total)
    _extent(forces, inside, centres, size_mm, most, numbers)
    numbers[11], n = _slip_share(forces, inside, most, numbers), active.shape[0]
    for i in range(root.shape[0]):
        normal, along, turning, across = 0.0, 0.0, 0.0, 0.0
        for a in range(n):
            if within[active[a]]:
                right, down = centres[active[a], 0] - x, centres[active[a], 1] - y
                normal, along, across = normal + root[i, a], along + root[i, n + a], across + right * root[i, a]
                turning += right * root[i, 2 * n + a] - down * root[i, n + a]
        numbers[12] += normal * normal
        numbers[13] += along * along
        numbers[14] += turning * turning
        numbers[15] += (across / total) ** 2
    for j in range(12, 16):
        numbers[j] = math.sqrt(numbers[j])


@compiled()
def _contacts(forces, root, active, centres, shape, size_mm):
    """As `contacts.numbers_of_contacts`, but in any order."""
    patches, total_n = forces.shape[1], 0.0
    part = np.empty(patches, np.int64)
    count, kept = _parts(forces[0], shape, part), 0
    total, which, numbers = np.zeros(count + 1), np.empty(patches, np.int64), np.zeros((count, 16))
    for k in range(patches):
        total[part[k]] += forces[0, k]
        total_n += forces[0, k]
    for number in range(1, count + 1):
        if total[number] < contacts.LEAST_SHARE * total_n:
            continue
        inside = 0
        for k in range(patches):
            if part[k] == number:
                which[inside] = k
                inside += 1
        _contact(forces, root, active, which[:inside], centres, size_mm, numbers[kept])
        kept += 1
    return numbers[:kept]


@compiled(
    'Tuple((f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1]))(f8[:, ::1], i8[::1], f4[:, ::1], '
    'f4[:, :, ::1], f8[:, ::1], i8[::1], UniTuple(i8, 2), UniTuple(f8, 2), i8)'
)
def sums(forces, active, root, surface, centres, bin_of, shape, size_mm, bins):
    """As `explain.field.sums.sums`, from a field, the surface's motion, and the patches' centres, bins, shape, size."""
    moved, on_bins, off_bins = np.zeros_like(forces), np.zeros((3, bins)), np.zeros(bins)
    wrench, covariance = np.zeros(6), np.zeros((6, 6))
    _move(forces, surface, shape, size_mm, moved)
    _on_bins(moved, root, active, bin_of, on_bins, off_bins)
    _wrench(moved, root, active, centres, wrench, covariance)
    return moved, on_bins, off_bins, wrench, covariance, _contacts(moved, root, active, centres, shape, size_mm)
