"""Response around a press, and what regions see of it, compiled: see `axisymmetric.AxisymmetricResponse`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.loops.common import compiled, spline_weights


@compiled()
def _along(force, k, weights, profiles, result):
    """Profiles over distance at a force: fills in (2, profiles, distances), values and slopes by force."""
    for p in range(profiles.shape[0]):
        for d in range(profiles.shape[1]):
            value, slope = 0.0, 0.0
            for f in range(4):
                value += profiles[p, d, k + f] * weights[0, f]
                slope += profiles[p, d, k + f] * weights[1, f]
            result[0, p, d] = value * force
            result[1, p, d] = value + slope * force


@compiled()
def _seen_along(couplings, columns, slopes, motion, motion_slopes):
    """The motion of one region and its three slopes, from the region's columns and their slopes."""
    for channel in range(2):
        total, by_x, by_y, by_force = 0.0, 0.0, 0.0, 0.0
        for c in range(columns.shape[0]):
            share = couplings[channel, c]
            total += share * columns[c]
            by_x += share * slopes[0, c]
            by_y += share * slopes[1, c]
            by_force += share * slopes[2, c]
        motion[channel] = total
        motion_slopes[0, channel], motion_slopes[1, channel], motion_slopes[2, channel] = by_x, by_y, by_force


@compiled()
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


@compiled()
def _shown(x, y, aslant_x, aslant_y, numbers, away, bend):
    """Place of a press as the region's smear shows it, and its slopes; as `axisymmetric.radial_smear.RadialSmear`."""
    square, along = x * x + y * y, x * aslant_x + y * aslant_y
    near, wide = 1 / (1 + square / numbers[8] ** 2), 1 / (1 + square / numbers[9] ** 2)
    shift, squeeze = numbers[10] * near, numbers[11] * wide
    fading = 2 * (along * squeeze * wide / numbers[9] ** 2 - shift * near / numbers[8] ** 2)
    bend[0], bend[1] = fading * x - squeeze * aslant_x, fading * y - squeeze * aslant_y
    away[0], away[1] = x + (shift - along * squeeze) * aslant_x, y + (shift - along * squeeze) * aslant_y


@compiled(
    'void(f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1], f8[::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, :, ::1], '
    'f8[:, :, ::1])'
)
def motion_and_slopes(contacts, places, couplings, profiles, numbers, axes, motion, slopes, columns):
    """As `AxisymmetricResponse.motion_slopes_and_columns`: fills in (n, regions, 2), (3, n, regions, 2) and columns.

    `numbers` are the number of lateral profiles, the hardest force, width, softness, bend, core and least distance,
    then the numbers of the radial smear. `axes` are low, high and intervals of the splines over distance and force.
    """
    hardest, width, softness, bend, least = numbers[1], numbers[2], numbers[3], numbers[4], numbers[6]
    count = profiles.shape[0]
    along = np.empty((2, count, profiles.shape[1]))
    weights, near, toward = np.empty((2, 4)), np.empty((2, 4)), np.empty(2)
    value, outward, by_force = np.empty(count), np.empty(count), np.empty(count)
    column_slopes = np.empty((3, couplings.shape[2]))
    region_slopes, away, bent = np.empty((3, 2)), np.empty(2), np.empty(2)
    for n in range(contacts.shape[0]):
        force = contacts[n, 2] * softness
        k = spline_weights(force, axes[1], weights)
        if force >= hardest:
            weights[1, :] = 0.0
        _along(force, k, weights, profiles, along)
        for r in range(places.shape[0]):
            x, y = (contacts[n, 0] - places[r, 0]) / width, (contacts[n, 1] - places[r, 1]) / width
            aslant_x, aslant_y = places[r, 0] / numbers[7], places[r, 1] / numbers[7]
            _shown(x, y, aslant_x, aslant_y, numbers, away, bent)
            distance = np.sqrt(away[0] * away[0] + away[1] * away[1] + least * least)
            toward[0], toward[1] = away[0] / distance, away[1] / distance
            i = spline_weights(np.arcsinh(distance / bend), axes[0], near)
            per_mm = 1 / np.sqrt(distance * distance + bend * bend)
            for p in range(count):
                value_at, out, more = 0.0, 0.0, 0.0
                for j in range(4):
                    value_at += along[0, p, i + j] * near[0, j]
                    out += along[0, p, i + j] * near[1, j]
                    more += along[1, p, i + j] * near[0, j]
                value[p], outward[p], by_force[p] = value_at, out * per_mm, more * softness
            core = np.tanh(distance / numbers[5])
            _columns(value, outward, by_force, toward, core, distance, numbers, columns[n, r], column_slopes)
            _seen_along(couplings[r], columns[n, r], column_slopes, motion[n, r], region_slopes)
            for channel in range(2):
                over = aslant_x * region_slopes[0, channel] + aslant_y * region_slopes[1, channel]
                for axis in range(2):
                    slopes[axis, n, r, channel] = region_slopes[axis, channel] + over * bent[axis]
                slopes[2, n, r, channel] = region_slopes[2, channel]


@compiled('void(f8[:, ::1], f4[:, :, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, :, ::1])')
def add_by_sides(contacts, per_n, grid, motion, slopes):
    """As `by_sides.BySides.motion_and_slopes`, added to (n, regions, 2) and (3, n, regions, 2).

    `grid` is the first middle of a patch, the size of a patch and the number of patches, along x and along y.
    """
    low, part, cols = np.empty(2, np.int64), np.empty(2), int(grid[0, 2])
    for n in range(contacts.shape[0]):
        for axis in range(2):
            last = grid[axis, 2] - 1
            steps = min(max((contacts[n, axis] - grid[axis, 0]) / grid[axis, 1], 0.0), last)
            low[axis] = min(int(steps), int(last) - 1)
            part[axis] = steps - low[axis]
        corner, force = low[1] * cols + low[0], contacts[n, 2]
        for r in range(motion.shape[1]):
            for channel in range(2):
                here, beside = per_n[corner, r, channel], per_n[corner + 1, r, channel]
                below, across = per_n[corner + cols, r, channel], per_n[corner + cols + 1, r, channel]
                upper, lower = here + part[0] * (beside - here), below + part[0] * (across - below)
                one = upper + part[1] * (lower - upper)
                motion[n, r, channel] += force * one
                along_x = (beside - here + part[1] * (across - below - beside + here)) / grid[0, 1]
                slopes[0, n, r, channel] += force * along_x
                slopes[1, n, r, channel] += force * (lower - upper) / grid[1, 1]
                slopes[2, n, r, channel] += one


@compiled('void(f8[:, :, :, ::1], f8[:, :, ::1], f8[:, :, :, ::1], f8[:, :, ::1])')
def motion_variance(slopes, columns, unsure, off):
    """As `AxisymmetricResponse.variance`: fills in (n, regions, 2)."""
    count = columns.shape[2]
    for n in range(columns.shape[0]):
        for r in range(columns.shape[1]):
            for channel in range(2):
                total = 0.0
                for f in range(unsure.shape[3]):
                    along = -slopes[0, n, r, channel] * unsure[r, channel, count, f]
                    along -= slopes[1, n, r, channel] * unsure[r, channel, count + 1, f]
                    for c in range(count):
                        along += columns[n, r, c] * unsure[r, channel, c, f]
                    total += along * along
                off[n, r, channel] = total
