"""Uniform cubic B-splines: values at knots, slopes, and what they can represent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.explain.splines import SplineAxis, cubes, laplacian, value_and_slopes

AXES = SplineAxis(-3.0, 5.0, 4), SplineAxis(-1.0, 1.0, 5), SplineAxis(0.0, 2.0, 3)


def places_on(axis: SplineAxis) -> st.SearchStrategy[float]:
    return st.floats(axis.low, axis.high)


def cubic_coefficients(axis: SplineAxis, roots: tuple[float, float, float]) -> np.ndarray:
    """Of (x - a)(x - b)(x - c), by its polar form (blossom) at the three knots within each spline's support."""
    step = (axis.high - axis.low) / axis.intervals
    knots = axis.low + step * (np.arange(axis.count)[:, None] + [-2, -1, 0])
    a, b, c = roots
    orders = [(a, b, c), (a, c, b), (b, a, c), (b, c, a), (c, a, b), (c, b, a)]
    return np.mean([np.prod(knots - order, axis=1) for order in orders], axis=0)


@pytest.mark.parametrize('knot', [0, 1, 2, 3, 4])
def test_at_a_knot_the_splines_are_a_sixth_four_sixths_and_a_sixth(knot: int) -> None:
    row = AXES[0].design(np.array([-3.0 + 2 * knot]))[0]
    np.testing.assert_allclose(row[knot : knot + 3], [1 / 6, 4 / 6, 1 / 6], atol=1e-15)
    assert abs(row).sum() == pytest.approx(1.0, abs=1e-15)


def test_between_two_knots_they_are_1_23_23_and_1_of_48() -> None:
    first, pair = AXES[0].weights(0.0)  # the middle of the interval from -1 to 1
    assert first == 1
    np.testing.assert_allclose(pair[0], np.array([1, 23, 23, 1]) / 48, atol=1e-15)


@settings(max_examples=25, deadline=None)
@given(st.floats(-10, 10))
def test_the_splines_add_up_to_one_everywhere(value: float) -> None:
    assert AXES[0].design(np.array([value])).sum() == pytest.approx(1.0, abs=1e-12)
    values, slopes = AXES[0].weights(value)[1]
    assert values.sum() == pytest.approx(1.0, abs=1e-12)
    assert slopes.sum() == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.floats(-10, 10))
def test_one_place_and_many_have_the_same_splines(value: float) -> None:
    first, pair = AXES[0].weights(value)
    row = np.zeros(AXES[0].count)
    row[first : first + 4] = pair[0]
    np.testing.assert_allclose(AXES[0].design(np.array([value]))[0], row, atol=1e-14)


@pytest.mark.parametrize(('beyond', 'end'), [(-9.0, -3.0), (9.0, 5.0)])
def test_beyond_the_ends_values_are_those_at_the_end(beyond: float, end: float) -> None:
    np.testing.assert_array_equal(AXES[0].design(np.array([beyond])), AXES[0].design(np.array([end])))


@settings(max_examples=25, deadline=None)
@given(places_on(AXES[0]), st.tuples(*[st.floats(-5, 5)] * 3))
def test_every_cubic_is_reproduced(x: float, roots: tuple[float, float, float]) -> None:
    made = AXES[0].design(np.array([x])) @ cubic_coefficients(AXES[0], roots)
    assert made[0] == pytest.approx((x - roots[0]) * (x - roots[1]) * (x - roots[2]), abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(places_on(AXES[0]), places_on(AXES[1]), places_on(AXES[2]))
def test_products_of_cubics_and_their_slopes_are_reproduced(x: float, y: float, s: float) -> None:
    """f = (x - 1)² x  (y + 1/2) y²  (s - 1)³; coefficients and result are 32 bit floats."""
    each = [cubic_coefficients(a, r) for a, r in zip(AXES, [(1, 1, 0), (-0.5, 0, 0), (1, 1, 1)], strict=True)]
    table = np.einsum('i,j,k->ijk', *each)[..., None].astype(np.float32)
    fx, fy, fs = (x - 1) ** 2 * x, (y + 0.5) * y**2, (s - 1) ** 3
    dx, dy, ds = (x - 1) * (3 * x - 1), 3 * y**2 + y, 3 * (s - 1) ** 2
    expected = [fx * fy * fs, dx * fy * fs, fx * dy * fs, fx * fy * ds]
    np.testing.assert_allclose(value_and_slopes(AXES, table, (x, y, s))[:, 0], expected, atol=5e-4)


@settings(max_examples=25, deadline=None)
@given(st.floats(-2.9, 4.9), st.floats(-0.99, 0.99), st.floats(0.01, 1.99), st.integers(0, 9))
def test_slopes_are_those_of_differences(x: float, y: float, s: float, seed: int) -> None:
    shape = tuple(axis.count for axis in AXES)
    table = np.random.default_rng(seed).normal(size=(*shape, 2)).astype(np.float32)
    here = np.array([x, y, s])
    slopes = value_and_slopes(AXES, table, here.tolist())[1:]
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        ends = cubes(*AXES, np.stack([here + step, here - step])) @ table.reshape(-1, 2).astype(float)
        np.testing.assert_allclose(slopes[axis], (ends[0] - ends[1]) / 2e-4, atol=2e-2)


def test_rows_of_cubes_are_products_with_x_slowest() -> None:
    place = np.array([[0.3, 0.2, 0.9]])
    each = [axis.design(place[:, i])[0] for i, axis in enumerate(AXES)]
    np.testing.assert_allclose(cubes(*AXES, place)[0], np.einsum('i,j,k->ijk', *each).reshape(-1), atol=1e-15)


@settings(max_examples=25, deadline=None)
@given(places_on(AXES[0]), places_on(AXES[1]), places_on(AXES[2]))
def test_the_laplacian_of_products_of_cubics_is_reproduced(x: float, y: float, s: float) -> None:
    """Of f above: (6x - 4) (y + 1/2) y² (s - 1)³ + (x - 1)² x (6y + 1) (s - 1)³."""
    each = [cubic_coefficients(a, r) for a, r in zip(AXES, [(1, 1, 0), (-0.5, 0, 0), (1, 1, 1)], strict=True)]
    table = np.einsum('i,j,k->ijk', *each)[..., None].astype(np.float32)
    expected = ((6 * x - 4) * (y + 0.5) * y**2 + (x - 1) ** 2 * x * (6 * y + 1)) * (s - 1) ** 3
    np.testing.assert_allclose(laplacian(AXES, table, (x, y, s)), expected, atol=2e-3)
