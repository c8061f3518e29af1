"""The graph of a response readout: `tactile_nodes.sensing.explain.measured.response` in ONNX, for one contact.

Places and forces are 64 bit floats and features 32 bit floats, as in numpy. Operations that ONNX lacks are written out:
systems of three equations with cofactors, and systems for missing regions with conjugate gradients.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tactile_nodes.learning.onnx_files.graph import Value, Writer
from tactile_nodes.learning.onnx_files.parts import Answer, Inputs, hypot
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.contact_shape import (
    DOUBT_OF_SHIFT,
    DOUBT_PER_MM2,
    SHIFT_INFORMATION,
    SURE_OF_WIDTH,
    USUAL_MISFIT,
    USUAL_MM2,
    WIDE_MM2,
)
from tactile_nodes.sensing.explain.measured.readout import SURE_OF_DIRECTIONS, ResponseReadout
from tactile_nodes.sensing.explain.measured.response import (
    CONVERGED_MM,
    DAMPING,
    LARGEST_STEP_MM,
    MOST_STEPS,
    WORTHWHILE_GAIN,
    Response,
)
from tactile_nodes.sensing.explain.reading import BEYOND_UNLIKENESS, UNKNOWN
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.explain.uncertainty import NOWHERE_MM
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32

_SOME_RIM = 1e-6
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def write_response(writer: Writer, readout: ResponseReadout, inputs: Inputs) -> Answer:
    """Scaled features to the single contact with the best fit, its uncertainty, and the bins' forces."""
    scores, left_over = _project(inputs, readout.likeness)
    known = (
        readout.likeness.directions.shape[1] // readout.scaling.trusted.size * int((readout.scaling.trusted > 0).sum())
    )
    enough = known - inputs.missing.sum() >= len(readout.likeness.directions)
    # For NaN and infinity, the difference of a number to itself is NaN.
    finite = enough & ~writer.op('IsNaN', (scores - scores).sum() + (left_over - left_over), dtype=bool)
    components = readout.whitening @ finite.where(scores, 0)
    place, misfit, information = _locate(readout.response, components, readout.calibration.least_gain)
    unlike = (misfit.sqrt() / readout.calibration.misfit_limit).most(left_over)
    return _answer(readout, finite, components, place, misfit, information, unlike)


def _project(inputs: Inputs, likeness: Likeness) -> tuple[Value, Value]:
    """Scores along the principal directions, and the remainder in units of its limit; see `project`."""
    directions, scaled, writer = likeness.directions, inputs.scaled, inputs.scaled.writer
    along = directions @ scaled
    lost = inputs.missing.sum()
    scores = writer.choose(
        lost < 0.5, lambda: writer.op('Identity', along), lambda: _without(directions, along, inputs.missing)
    )
    squared, count = scaled @ scaled, (directions.shape[1] - lost).most(1)
    left = (squared - scores @ along).most(0)
    left_over = (left / count).sqrt() / (likeness.floor + likeness.share * (squared / count).sqrt())
    return scores, left_over


def _without(directions: np.ndarray, along: Value, missing: Value) -> Value:
    """Scores if some inputs are missing: the least-squares system, solved by conjugate gradients."""
    count = len(directions)
    overlap = (directions * missing.reshape(1, -1)) @ np.ascontiguousarray(directions.T)
    square = (np.eye(count, dtype=np.float32) * np.float32(1 + SURE_OF_DIRECTIONS) - overlap).cast(np.float64)
    right = along.cast(np.float64)
    enough = (right @ right) * 1e-18

    def step(solved: Value, residual: Value, towards: Value, size: Value) -> tuple[Value, list[Value]]:
        moved = square @ towards
        share = size / (towards @ moved)
        residual = residual - share * moved
        smaller = residual @ residual
        return enough < smaller, [solved + share * towards, residual, residual + smaller / size * towards, smaller]

    # Rounding may require twice as many steps as unknowns. Without any signal there is nothing to solve.
    solved = along.writer.loop(2 * count, [right * 0, right, right, right @ right], step, enough < right @ right)
    return solved[0].cast(np.float32)


def _start(response: Response, components: Value) -> Value:
    """The nearest entry of the table; see `Response.start`."""
    writer, table = components.writer, response.start_components
    norms = (table**2).sum(axis=1)
    lightest = response.starts[:, 2] == response.starts[:, 2].min()
    along = table @ components
    share = writer.constant(lightest).where((along / np.maximum(norms, 1e-9)).most(0).least(1), 1)
    best = writer.op('ArgMin', share * (share * norms - 2 * along), axis=0, keepdims=0, dtype=np.int64)
    entry = writer.op('Gather', writer.constant(response.starts), best, axis=0)
    chosen = writer.op('Gather', share, best, axis=0).cast(np.float64)
    return writer.concat(entry[0], entry[1], entry[2] * chosen)


def _locate(response: Response, components: Value, least_gain: float) -> tuple[Value, Value, Value]:
    """The best contact over all steps, its misfit and its information; see `locate`."""
    writer = components.writer
    largest = np.array([LARGEST_STEP_MM, LARGEST_STEP_MM, response.s.high / 4])
    low, high = np.array([response.x.low, response.y.low, 0.0]), np.array([axis.high for axis in response.axes])

    def step(current: Value, best: Value, least: Value, known: Value) -> tuple[Value, list[Value]]:
        misfit, information, slope = _compare(response, components, current)
        better = misfit < least
        place, lower = better.where(current, best), misfit.least(least)
        hardly = least - lower < 2 * WORTHWHILE_GAIN / len(response.growth)
        in_vain = hardly & (_gained(response, components, place, lower) < least_gain)
        ahead = _solve(information + np.diag(DAMPING), slope)
        moved = (current + ahead.most(-largest).least(largest)).most(low).least(high)
        go_on = writer.op('Abs', moved - current).max() >= CONVERGED_MM
        return go_on & ~in_vain, [moved, place, lower, better.where(information, known)]

    begin = _start(response, components)
    nothing = writer.constant(np.zeros((3, 3)))
    worst = writer.constant(np.float32(np.finfo(np.float32).max))
    _, best, least, information = writer.loop(MOST_STEPS, [begin, begin, worst, nothing], step)
    return best, least, information


def _gained(response: Response, components: Value, place: Value, misfit: Value) -> Value:
    """How much more probable a contact is than no contact; see `gained`."""
    nothing = (components * components * _certainty(response, place[2])).mean()
    return (nothing - misfit) * (len(response.growth) / 2)


def _compare(response: Response, components: Value, current: Value) -> tuple[Value, Value, Value]:
    """Misfit, information and descent direction."""
    modelled, slopes = components.writer.split(value_and_slopes(response.axes, response.coefficients, current), 1, 3)
    left, certainty = components - modelled.reshape(-1), _certainty(response, current[2])
    slopes = slopes.cast(np.float64)
    weighted = slopes * certainty.cast(np.float64)
    return (left * left * certainty).mean(), weighted.times_transposed(slopes), weighted @ left.cast(np.float64)


def _certainty(response: Response, s: Value) -> Value:
    share = (s / response.s.high) ** 2.0
    return 1 / (1 + share.cast(np.float32) * response.growth)


def _cofactors(square: Value) -> tuple[Value, Value]:
    """Cofactors and determinant of a 3x3 matrix. For a symmetric matrix, their quotient is the inverse."""
    flat = square.reshape(-1)
    (a, b), (c, d) = ([flat.take(3 * rows[:, None] + cols) for cols in (_NEXT, _AFTER)] for rows in (_NEXT, _AFTER))
    cofactors = a * d - b * c
    return cofactors, (square[0] * cofactors[0]).sum()


def _solve(square: Value, right: Value) -> Value:
    cofactors, determinant = _cofactors(square)
    return cofactors @ right / determinant


def _answer(
    readout: ResponseReadout, finite: Value, components: Value, place: Value, misfit: Value, information: Value,
    unlike: Value,
) -> Answer:  # fmt: skip
    """Forces, contact and uncertainty. The force is zero where it may be noise; see `ResponseReadout.reading`."""
    writer, calibration, response = components.writer, readout.calibration, readout.response
    cofactors, determinant = _cofactors(information + np.diag(DAMPING))
    variances = cofactors.reshape(-1).take(np.array([0, 4, 8])) / determinant
    usual = USUAL_MISFIT * calibration.misfit_limit**2

    def noise_without(explained: Value | float) -> Value:
        """See `contact_shape.Residual.noise_without`."""
        return ((misfit.cast(np.float64) - explained / len(readout.whitening)) / usual).most(1)

    gained = _gained(response, components, place, misfit).cast(np.float64)
    noise = gained < noise_without(0.0) * calibration.least_gain
    corrected, doubt, beyond = _corrected(readout, components, place, cofactors / determinant, noise_without)
    corrected = noise.where(place, corrected)
    height = corrected[2] / response.s.high
    fitted_mm = ((variances[0] + variances[1]) / 2).sqrt()
    sigma_mm = _factor(calibration.place_factors, height) * hypot(fitted_mm, calibration.place_floor_mm)
    sigma_n = _factor(calibration.force_factors, height) * hypot(variances[2].sqrt(), calibration.force_floor_n)
    doubt = noise.where(doubt * 0, doubt)
    sigma_mm = hypot(sigma_mm, ((doubt[0] + doubt[1]) / 2).sqrt())
    sigma_n = hypot(sigma_n, doubt[2].sqrt())
    most = writer.constant(np.float32(BEYOND_UNLIKENESS))
    unlike = noise.where(unlike, beyond.where(unlike.most(most), unlike))
    nowhere = writer.constant(np.float64(NOWHERE_MM))
    sigma_mm = noise.where(nowhere, sigma_mm.least(nowhere))
    force = corrected[2].most(0)
    force = noise.where(force * 0, force)
    bins = _spread(corrected, sigma_mm, force, readout.bins)
    contact = writer.concat(corrected[0], corrected[1], force)
    return Answer(*(finite.where(each, UNKNOWN) for each in (bins, contact, sigma_mm, sigma_n, unlike)))


def _corrected(
    readout: ResponseReadout, components: Value, place: Value, inverse: Value, noise_without: Callable[[Value], Value]
) -> tuple[Value, Value, Value]:
    """The contact with a usual width, extra variances of x, y and s, and whether it lies at an end.

    See `contact_shape` and `ResponseReadout.beyond`. `inverse` is the inverse of the damped information.
    """
    response = readout.response
    low, high = np.array([response.x.low, response.y.low, -1.0]), np.array([axis.high for axis in response.axes])
    largest = np.array([LARGEST_STEP_MM, LARGEST_STEP_MM, response.s.high / 4])
    modelled, slopes = place.writer.split(value_and_slopes(response.axes, response.coefficients, place), 1, 3)
    certainty = _certainty(response, place[2]).cast(np.float64)
    left, slopes = (components - modelled.reshape(-1)).cast(np.float64) * certainty, slopes.cast(np.float64)
    step, share = _width(response, place, inverse, slopes, left, certainty, noise_without)
    by_shift, gain = _shifted(readout.shifts, inverse, slopes, left, certainty)
    dragged = gain >= noise_without(gain * 2) * readout.most_shift_gain
    by_width = place * np.array([0.0, 0.0, 1.0]) * share
    by_drag = dragged.where(by_shift * DOUBT_OF_SHIFT, by_shift * 0)
    doubt = by_drag * by_drag + by_width * by_width
    at_end = (place - (high - CONVERGED_MM)).most((low + CONVERGED_MM) - place).max() >= 0
    moved = (place + step.most(-largest).least(largest)).most(np.maximum(low, [-np.inf, -np.inf, 0.0])).least(high)
    return at_end.where(place, moved), doubt, ~(~at_end & ~_near_ends(response, place))


def _near_ends(response: Response, place: Value) -> Value:
    """See `Response.near_ends`."""
    low, high = np.array([response.x.low, response.y.low]), np.array([response.x.high, response.y.high])
    steps = np.array([(axis.high - axis.low) / axis.intervals for axis in (response.x, response.y)])
    across = place.take(np.array([0, 1]))
    rim: Value = ((across - (high - steps)).most((low + steps) - across) / steps).most(0).sum()
    near: Value = (rim >= _SOME_RIM) & (place[2] >= (1 - rim) * response.hard)
    return near


def _width(
    response: Response,
    place: Value,
    inverse: Value,
    slopes: Value,
    left: Value,
    certainty: Value,
    noise_without: Callable[[Value], Value],
) -> tuple[Value, Value]:
    """The changes of x, y and s at a usual width, and the uncertain share of the force; see `contact_shape`.

    A least-squares step in x, y, s and width, with the width eliminated separately.
    """
    bend = laplacian(response.axes, response.coefficients, place).cast(np.float64)
    shared = slopes @ (bend * certainty)
    known = inverse @ shared
    own = (bend * bend * certainty).sum() - shared @ known
    width = (bend @ left - known @ (slopes @ left)) / own
    usual = width * (own * USUAL_MM2**2) / (own * USUAL_MM2**2 + 1)
    wide = (width >= WIDE_MM2) & (width >= (noise_without(width * width * own) / own).sqrt() * SURE_OF_WIDTH)
    step: Value = inverse @ (slopes @ left) - known * usual
    return step, wide.where(width * DOUBT_PER_MM2, width * 0)


def _shifted(shifts: np.ndarray, inverse: Value, slopes: Value, left: Value, certainty: Value) -> tuple[Value, Value]:
    """See `contact_shape`; for features with two channels, whose equations are solved explicitly."""
    weighted = certainty * shifts
    by_contact = slopes.times_transposed(weighted)
    shared = inverse @ by_contact
    down = shifts @ left - (slopes @ left) @ shared
    own = (
        weighted @ np.ascontiguousarray(shifts.T) - by_contact.transposed_times(shared) + SHIFT_INFORMATION * np.eye(2)
    )
    along_x, along_y = own[0], own[1]
    determinant = along_x[0] * along_y[1] - along_x[1] * along_y[0]
    first = (down[0] * along_y[1] - down[1] * along_x[1]) / determinant
    second = (down[1] * along_x[0] - down[0] * along_x[1]) / determinant
    step = down.writer.concat(first, second)
    gain: Value = (down @ step) * 0.5
    return shared @ step, gain


def _factor(factors: tuple[float, ...], height: Value) -> Value:
    """Linear interpolation between equal steps; see `factor_at`."""
    along = height.most(0).least(1) * (len(factors) - 1)
    below = along.cast(np.int64).least(max(len(factors) - 2, 0))
    writer, numbers = height.writer, height.writer.constant(np.array(factors, np.float64))
    ends = [writer.op('Gather', numbers, each, axis=0) for each in (below, (below + 1).least(len(factors) - 1))]
    return ends[0] + (along - below.cast(np.float64)) * (ends[1] - ends[0])


def _spread(place: Value, sigma: Value, force: Value, bins: BinGrid) -> Value:
    """The force on each bin; see `spread_over_bins`."""
    scale = sigma.most(1e-6) * math.sqrt(2)
    along_x = _shares(place[0], scale, bins.cols, bins.width_mm)
    along_y = _shares(place[1], scale, bins.rows, bins.height_mm)
    return along_y.reshape(-1, 1) * along_x * force


def _shares(at: Value, scale: Value, count: int, size_mm: float) -> Value:
    borders = size_mm * (np.arange(1, count) / count - 0.5)
    writer = at.writer
    # 32 bits are enough for shares, and not every runtime supports this function in 64 bits.
    below = writer.op('Erf', ((borders - at) / scale).cast(np.float32)).cast(np.float64) * 0.5 + 0.5
    zero, one = writer.constant(np.zeros(1)), writer.constant(np.ones(1))
    return writer.op('Concat', below, one, axis=0) - writer.op('Concat', zero, below, axis=0)


_VALUE_AND_SLOPES = [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]
"""Value (0) or slope (1) of the splines along x, y and s: for the value, and for its slopes along x, y and s."""
_BENDS = [2, 0, 0], [0, 2, 0]
"""Second derivative (2) along x, and along y."""


def value_and_slopes(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value
) -> Value:
    """(4, outputs): the function at one place (3,), and its slopes along x, y and s."""
    return _derivatives(axes, coefficients, at, _VALUE_AND_SLOPES)


def laplacian(
    axes: tuple[SplineAxis, SplineAxis, SplineAxis], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value
) -> Value:
    """(outputs,): the sum of the second derivatives along x and y at one place (3,)."""
    return np.ones(2, np.float32) @ _derivatives(axes, coefficients, at, _BENDS)


def _derivatives(
    axes: tuple[SplineAxis, ...], coefficients: Float32[np.ndarray, 'nx ny ns outputs'], at: Value,
    which: Sequence[Sequence[int]],
) -> Value:  # fmt: skip
    writer = at.writer
    first, splines = _splines(axes, at)
    table = writer.constant(coefficients)
    block = writer.op('Slice', table, first, first + 4, writer.constant(np.arange(3)))
    weights = _products(splines, np.array(which)).reshape(len(which), 64).cast(np.float32)
    return weights @ block.reshape(64, coefficients.shape[-1])


def _splines(axes: tuple[SplineAxis, ...], at: Value) -> tuple[Value, Value]:
    """Number of the first of the four splines of each axis, and their values, slopes and second derivatives (3, 12)."""
    low, high = (np.array([getattr(axis, end) for axis in axes]) for end in ('low', 'high'))
    intervals = np.array([axis.intervals for axis in axes])
    along = (at.most(low).least(high) - low) * intervals / (high - low)
    first = along.cast(np.int64).least(intervals - 1)
    t = (along - first.cast(np.float64)).reshape(3, 1)
    square = t * t
    powers = at.writer.op('Concat', t * 0 + 1, t, square, square * t, axis=1)
    per_unit = np.repeat((intervals / (high - low))[:, None] ** np.arange(3), 4, axis=1)
    return first, powers @ _polynomials() * per_unit


def _polynomials() -> np.ndarray:
    """Matrix from 1, t, t² and t³ to the four splines, their slopes and second derivatives (4, 12)."""
    values = [SplineAxis(0.0, 1.0, 1).weights(t)[1].reshape(-1) for t in (0.0, 0.25, 0.5, 1.0)]
    both = np.linalg.solve(np.vander([0.0, 0.25, 0.5, 1.0], increasing=True), np.array(values))
    return np.hstack([both, np.diag([1.0, 2.0, 3.0], k=1) @ both[:, 4:]])


def _products(splines: Value, which: np.ndarray) -> Value:
    """(n, 4, 4, 4): products of the splines along x, y and s. `which` gives the order of the derivatives."""
    flat, numbers = splines.reshape(-1), np.arange(4)
    x, y, s = (
        flat.take((12 * axis + 4 * which[:, axis, None] + numbers).reshape(-1, *shape))
        for axis, shape in enumerate(((4, 1, 1), (1, 4, 1), (1, 1, 4)))
    )
    return x * y * s
