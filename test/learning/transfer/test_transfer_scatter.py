"""How regions are expected to scatter: outwards and across, wherever in the image they are."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.learning.transfer.whole import LEAST_SCATTER, Scatter, outwards
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse

LATERAL, COLUMNS = 1, 3
NUMBERS = 2 * COLUMNS + 2
FREE = 10
X, Y = NUMBERS - 2, NUMBERS - 1
RIGHT, BELOW, ASLANT = np.array([[0.5, 0.0], [0.0, 0.5], [0.5, 0.5]]) * [[1.0], [1.0], [np.sqrt(0.5)]]


def response(count: int) -> AxisymmetricResponse:
    """Of so many regions, by one lateral and one vertical profile."""
    return AxisymmetricResponse(np.zeros((2, 24, 5)), LATERAL, 1.0, np.zeros((count, 2)), np.zeros((count, 2, COLUMNS)))


def circle(count: int, distance: float) -> np.ndarray:
    """Places in the image, all as far from its middle."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return distance * np.column_stack([np.cos(angle), np.sin(angle)])


def deeper(view: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """What regions are off by whose markers lie deeper: seen further out, and moving less away from a press."""
    along = view / np.hypot(*view.T)[:, None]
    less = depths[:, None, None] * (along[:, :, None] * along[:, None, :])
    couplings = np.concatenate([-0.5 * less, np.zeros((len(view), 2, COLUMNS - 2))], axis=2)
    return np.column_stack([couplings.reshape(len(view), -1), depths[:, None] * along])


@pytest.fixture(scope='module')
def scatter() -> Scatter:
    view = circle(200, 0.5)
    return Scatter.of(response(200), deeper(view, depths(200)), view, FREE)


def depths(count: int) -> np.ndarray:
    return 0.2 * np.random.default_rng(3).normal(size=count)


def test_what_is_outwards_is_right_on_the_right_and_down_below() -> None:
    turn = outwards(np.array([RIGHT, BELOW]), COLUMNS, LATERAL)
    assert turn[0] == pytest.approx(np.eye(NUMBERS))
    place = np.zeros(NUMBERS)
    place[[X, Y]] = 0.3, 0.7
    assert (turn[1] @ place)[[X, Y]] == pytest.approx([0.7, -0.3])


def test_turned_numbers_are_as_long_as_before() -> None:
    turn = outwards(circle(7, 0.8), COLUMNS, LATERAL)
    assert turn @ turn.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(NUMBERS), (7, 1, 1)), abs=1e-12)


def test_places_scatter_outwards_wherever_a_region_is(scatter: Scatter) -> None:
    right, below, aslant = scatter.covariance(np.array([RIGHT, BELOW, ASLANT]))
    var = np.square(depths(200)).sum() / (200 - FREE)
    assert right[[X, Y], [X, Y]] == pytest.approx([var + LEAST_SCATTER, LEAST_SCATTER])
    assert below[[X, Y], [X, Y]] == pytest.approx([LEAST_SCATTER, var + LEAST_SCATTER])
    assert aslant[X, Y] == pytest.approx(var / 2)


def test_what_depth_changes_goes_together(scatter: Scatter) -> None:
    right, below = scatter.covariance(np.array([RIGHT, BELOW]))
    var = np.square(depths(200)).sum() / (200 - FREE)
    # Motion along x by what moves along x, on the right; along y by what moves along y, below.
    assert right[0, X] == pytest.approx(-0.5 * var)
    assert below[COLUMNS + 1, Y] == pytest.approx(-0.5 * var)
    assert below[0, X] == pytest.approx(0.0, abs=1e-12)


def test_a_gel_is_as_likely_as_its_mirror_image() -> None:
    view = circle(200, 0.5)
    across = view[:, ::-1] * (-1.0, 1.0) / 0.5
    off = deeper(view, depths(200))
    off[:, X:] += depths(200)[:, None] * across  # as if seen to one side
    right = Scatter.of(response(200), off, view, FREE).covariance(RIGHT[None])[0]
    assert right[X, Y] == 0.0
    assert right[Y, Y] == pytest.approx(right[X, X])


def test_regions_further_out_scatter_by_what_is_seen_there() -> None:
    view = np.concatenate([circle(200, 0.1), circle(200, 0.9)])
    off = np.concatenate([np.zeros((200, NUMBERS)), deeper(circle(200, 0.9), depths(200))])
    near, far = Scatter.of(response(400), off, view, FREE).covariance(np.array([[0.1, 0.0], [0.9, 0.0]]))
    # Seven tenths by the ring alone, the rest by all round, of which half scatters.
    assert near[X, X] == pytest.approx(0.15 / 0.85 * far[X, X], rel=0.01)
