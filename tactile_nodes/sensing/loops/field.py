"""The force field that explains a motion, compiled: see `explain.field.solver.FieldSolver.field`."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

import math

import numpy as np

from tactile_nodes.sensing.elasticity.patches import PER_BIN
from tactile_nodes.sensing.explain.field import cone, solver
from tactile_nodes.sensing.loops.common import compiled, inverse_root

_NONE = np.float32(0)


@compiled()
def _products(rows, products):
    """Lower half of the products of rows with each other, four by two rows at a time with sums in registers."""
    count = rows.shape[0]
    for i in range(0, count, 4):
        places = i, min(i + 1, count - 1), min(i + 2, count - 1), min(i + 3, count - 1)
        one, two, three, four = rows[places[0]], rows[places[1]], rows[places[2]], rows[places[3]]
        for j in range(0, min(i + 4, count), 2):
            beside = min(j + 1, count - 1)
            left, right = rows[j], rows[beside]
            a, b, c, d, e, f, g, h = _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE
            for k in range(rows.shape[1]):
                x, y = left[k], right[k]
                a, b, c, d = a + one[k] * x, b + one[k] * y, c + two[k] * x, d + two[k] * y
                e, f, g, h = e + three[k] * x, f + three[k] * y, g + four[k] * x, h + four[k] * y
            for place, x, y in ((places[0], a, b), (places[1], c, d), (places[2], e, f), (places[3], g, h)):
                products[place, j], products[place, beside] = x, y


@compiled()
def _times_inverse(root, vector, product):
    """Set `product` to R'R times a vector, with R lower triangular."""
    n = vector.shape[0]
    for i in range(n):
        total = _NONE
        row = root[i]
        for j in range(i + 1):
            total += row[j] * vector[j]
        product[i] = _NONE
        for j in range(i + 1):
            product[j] += row[j] * total


@compiled()
def _least_squares(information, evidence, steps, forces):
    """As `cone.least_squares`, which explains the steps. Fills in the forces, returns whether they are separable."""
    n = evidence.shape[0]
    count, friction = n // 3, solver.FRICTION
    stepped, root = np.empty((n, n), np.float32), np.zeros((n, n), np.float32)
    trace = 0.0
    for i in range(n):
        trace += information[i, i]
    stiff = cone.STIFF * trace / n
    for i in range(n):
        for j in range(i + 1):
            stepped[i, j] = information[i, j]
        stepped[i, i] += np.float32(stiff)
    if not inverse_root(stepped, root):
        return False
    off, vector, begin = np.zeros(n), np.empty(n, np.float32), np.empty(n, np.float32)
    product = np.empty(n, np.float32)
    _times_inverse(root, evidence, begin)
    for i in range(n):
        forces[i] = 0.0
    for _ in range(steps):
        for i in range(n):
            vector[i] = forces[i] - off[i]
        _times_inverse(root, vector, product)
        for i in range(n):
            off[i] += cone.RELAXED * (begin[i] + stiff * product[i]) + (1 - cone.RELAXED) * forces[i]
        for i in range(count):
            normal, along_x, along_y = off[i], off[count + i], off[2 * count + i]
            size = math.sqrt(along_x * along_x + along_y * along_y)
            pressed = max((normal + friction * size) / (1 + friction * friction), normal, 0.0)
            share = min(friction * pressed / max(size, cone.TINY), 1.0)
            forces[i], forces[count + i], forces[2 * count + i] = pressed, share * along_x, share * along_y
        for i in range(n):
            off[i] -= forces[i]
    return True


@compiled()
def _evidence(by_force, on, weights, motion, granted, information, evidence):
    """As `FieldSolver._evidence`, for the motion that forces on some patches or bins cause.

    Returns the motion caused by each force, the camera's share, and the measured motion, all weighted, as rows.
    """
    single, shared = weights
    regions, ways, n, count = single.shape[0], shared.shape[1], evidence.shape[0], by_force.shape[0] // 3
    last = n + ways
    rows = np.empty((last + 1, regions), np.float32)
    for r in range(regions):
        root = math.sqrt(single[r])
        rows[last, r] = np.float32(root)
        for way in range(ways):
            rows[n + way, r] = shared[r, way] / np.float32(root)
    for i in range(n):
        source = by_force[i // on.shape[0] * count + on[i % on.shape[0]]]
        for r in range(regions):
            rows[i, r] = source[r] * rows[last, r]
    for r in range(regions):
        rows[last, r] *= np.float32(motion[r])
    products = np.empty((last + 1, last + 1), np.float32)
    _products(rows, products)
    most = _NONE
    for i in range(n):
        for j in range(i + 1):
            information[i, j] = products[i, j]
        evidence[i] = products[last, i]
        for way in range(n, last):
            for j in range(i + 1):
                information[i, j] -= products[way, i] * products[way, j]
            evidence[i] -= products[way, i] * products[last, way]
        most = max(most, information[i, i])
    for i in range(n):
        information[i, i] += max(np.float32(granted), np.float32(solver.UNSTABLE) * most)
    return rows


@compiled()
def _nearby(pressed, cols, near):
    """As `FieldSolver._nearby`."""
    rows = pressed.shape[0] // cols
    for row in range(rows):
        for col in range(cols):
            total = 0.0
            for y in range(max(row - 1, 0), min(row + 2, rows)):
                for x in range(max(col - 1, 0), min(col + 2, cols)):
                    total += pressed[y * cols + x]
            near[row * cols + col] = total / 9


@compiled()
def _hold(pressed, near, weight, regularization, held):
    """As `FieldSolver._held`."""
    total, above, squared = 0.0, 0.0, 0.0
    for k in range(pressed.shape[0]):
        more = max(pressed[k] - solver.UNSEEN_N / 2, 0.0)
        total, above, squared = total + pressed[k], above + more, squared + more * more
    wide = solver.WIDE / max(above * above / max(squared, 1e-12), 1.0)
    weight, total, mean = weight * min(1.0, wide * wide), max(total, solver.LEAST_N), 0.0
    for k in range(pressed.shape[0]):
        held[k] = weight / (near[k] + solver.SPREAD * total)
        mean += pressed[k] * held[k] / total
    for k in range(pressed.shape[0]):
        held[k] -= solver.CENTRED * (1 - regularization) * mean


@compiled()
def _squared(rows, forces):
    """As `Weights.squared`, for the residual motion. `rows`: weighted motion per force, of the camera, and measured."""
    n, last = forces.shape[0], rows.shape[0] - 1
    left = np.empty(rows.shape[1])
    for r in range(rows.shape[1]):
        left[r] = rows[last, r]
    for i in range(n):
        row = rows[i]
        for r in range(rows.shape[1]):
            left[r] -= forces[i] * row[r]
    total = 0.0
    for r in range(rows.shape[1]):
        total += left[r] * left[r]
    for way in range(n, last):
        camera, row = 0.0, rows[way]
        for r in range(rows.shape[1]):
            camera += left[r] * row[r]
        total -= camera * camera
    return max(total, 0.0)


@compiled()
def _on_bins(by_bin, on, around, bin_of, motion, weights, cols, regularization, pressed):
    """As `FieldSolver._on_bins`: fills in each patch's share of the normal force."""
    patches, bins, n = pressed.shape[0], on.shape[0], 3 * on.shape[0]
    near, held, by_place = np.empty(patches), np.empty(patches), np.zeros(around.shape[0])
    for k in range(patches):
        pressed[k] = around[bin_of[k]] / PER_BIN**2
    _nearby(pressed, cols, near)
    _hold(pressed, near, solver.HELD * regularization, regularization, held)
    for k in range(patches):
        by_place[bin_of[k]] += held[k]
    information, evidence = np.empty((n, n), np.float32), np.empty(n, np.float32)
    _evidence(by_bin, on, weights, motion, solver.GRANTED * regularization / PER_BIN**2, information, evidence)
    for i in range(bins):
        evidence[i] -= np.float32(solver.ON_BINS / PER_BIN**2 * by_place[on[i]])
    forces = np.empty(n)
    able = _least_squares(information, evidence, solver.FIRST_STEPS, forces)
    by_place[:] = 0.0
    for i in range(bins):
        by_place[on[i]] = forces[i]
    for k in range(patches):
        pressed[k] = by_place[bin_of[k]] / PER_BIN**2
    return able


@compiled()
def _chosen(values, limit, allowed, which):
    """Fill in the indices of allowed values above a limit, and return their number."""
    count = 0
    for k in range(values.shape[0]):
        if values[k] > limit and allowed[k]:
            which[count] = k
            count += 1
    return count


@compiled()
def _moves(caused):
    """Whether a force moves anything: as `FieldSolver._on_gel`."""
    for each in caused:  # noqa: SIM110 - numba compiles no generator
        if each != 0:
            return True
    return False


@compiled(
    'Tuple((b1, f8[:, ::1], i8[::1], f4[:, ::1], f8, f8))(UniTuple(f4[:, ::1], 2), i8[::1], f8[::1], f8[::1], '
    'Tuple((f4[::1], f4[:, ::1])), i8, UniTuple(f8, 2))'
)
def field(by_force, bin_of, around, motion, weights, cols, regularizing):
    """As `FieldSolver.field`, if there are bins to solve on: those above the limit, or all of one value.

    Args:
        by_force: motion caused by 1 N of each force on bins, and on patches.
        bin_of: the bin of each patch.
        around: normal forces on bins, none below 0.
        motion: motion of the regions along x and y.
        weights: weights of the regions, and the camera's share.
        cols: number of patch columns.
        regularizing: share of the regularization that is used, and the weight of the l1 term in light contacts.

    Returns:
        Whether the forces are separable, the forces, the patches that were solved on, the root of the forces'
        covariance, and the squares of the motion and of its residual.
    """
    regularization, lightly_held = regularizing
    patches, limit = bin_of.shape[0], 0.0
    for value in around:
        limit = max(limit, solver.ACTIVE * value)
    limit = max(limit, solver.LEAST_N)
    which, allowed = np.empty(patches, np.int64), np.empty(patches, np.bool_)
    for k in range(patches):
        allowed[k] = around[bin_of[k]] > limit and _moves(by_force[1][k])
    bins = which[: _chosen(around, limit, np.ones(around.shape[0], np.bool_), which)].copy()
    pressed, near, held = np.empty(patches), np.empty(patches), np.empty(patches)
    able = _on_bins(by_force[0], bins, around, bin_of, motion, weights, cols, regularization, pressed)
    _nearby(pressed, cols, near)
    highest = near.max()
    weight = min(solver.HELD * regularization, max(lightly_held, solver.HELD_PER_N * highest))
    _hold(pressed, near, weight, regularization, held)
    count = _chosen(near, solver.ACTIVE * highest, allowed, which) if able else 0
    active, n = which[:count].copy(), 3 * count
    forces, root = np.zeros((3, patches)), np.zeros((n, n), np.float32)
    information, evidence, found = np.empty((n, n), np.float32), np.empty(n, np.float32), np.zeros(n)
    rows = _evidence(by_force[1], active, weights, motion, solver.GRANTED * regularization, information, evidence)
    before = _squared(rows, found)
    for i in range(count):
        evidence[i] -= np.float32(held[active[i]])
    if count:
        able = _least_squares(information, evidence, cone.STEPS, found) and inverse_root(information, root)
    for i in range(n):
        forces[i // count, active[i % count]] = found[i]
    return able, forces, active, root, before, _squared(rows, found)
