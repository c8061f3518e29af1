from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.body import NO_BODY_MM, STEEPEST, Body, grid
from tactile_nodes.simulation.touch.families import FAMILIES, ball, make_body


def test_a_ball_has_the_height_and_slope_of_a_circle():
    body = Body.of_heights('ball', ball(5.0, *grid(8.0)))
    height, along_x, along_y = body.under(np.array([2.0]), np.array([0.0]))
    assert height[0] == pytest.approx(5 - 21**0.5, abs=1e-3)
    assert along_x[0] == pytest.approx(2 / 21**0.5, abs=1e-3)
    assert along_y[0] == pytest.approx(0.0, abs=1e-9)


def test_the_lowest_point_is_at_zero_and_beside_the_body_there_is_none():
    heights = np.full((41, 41), np.nan)
    heights[15:26, 15:26] = 7.5
    body = Body.of_heights('block', heights)
    assert body.under(np.array([0.0]), np.array([0.0]))[0][0] == 0
    assert body.under(np.array([1.9]), np.array([0.0]))[0][0] > 1.5
    assert body.under(np.array([40.0]), np.array([0.0]))[0][0] > 1.5


def test_walls_become_slopes_and_nothing_is_steeper():
    body = make_body('punch')
    steps = np.abs(np.diff(body.height_mm, axis=0)).max(), np.abs(np.diff(body.height_mm, axis=1)).max()
    assert max(steps) <= STEEPEST * body.spacing_mm * (1 + 1e-9)


def test_a_tilted_square_touches_with_a_corner():
    flat = Body.of_heights('square', np.where(np.abs(np.stack(grid(5.0))).max(axis=0) <= 3, 0.0, np.nan))
    tilted = flat.tilted(1.0, 2.0)
    row, column = np.unravel_index(tilted.height_mm.argmin(), tilted.height_mm.shape)
    assert (row - 50) * 0.1 == pytest.approx(3.0)
    assert (column - 50) * 0.1 == pytest.approx(3.0)
    middle = tilted.under(np.array([0.0]), np.array([0.0]))[0][0]
    assert middle == pytest.approx(3 * (np.tan(np.radians(1)) + np.tan(np.radians(2))), rel=1e-6)


@pytest.mark.parametrize('name', FAMILIES)
def test_every_family_has_bodies_of_its_own_size_and_others(name: str):
    usual, other = make_body(name), make_body(name, np.random.default_rng(5))
    assert usual.name == other.name == name
    assert usual.height_mm.min() == 0
    assert usual.reach_mm < 12
    if name != 'tip':
        assert usual.height_mm.shape == other.height_mm.shape
        assert not np.array_equal(usual.height_mm, other.height_mm)


def test_an_unknown_body_is_refused_with_the_known_ones():
    with pytest.raises(ConfigurationError, match="there is no body 'rign'; there are: tip, ball"):
        make_body('rign')


def test_heights_without_any_body_are_refused():
    with pytest.raises(ConfigurationError, match='has no finite height'):
        Body.of_heights('void', np.full((5, 5), np.inf))
    with pytest.raises(ConfigurationError, match='needs a square of heights'):
        Body.of_heights('strip', np.zeros((5, 7)))


def test_beside_a_body_heights_rise_to_where_none_is():
    assert make_body('tip').height_mm.max() <= NO_BODY_MM


def test_bodies_that_are_joined_touch_where_each_is():
    two = Body.joined('two', [(make_body('tip'), (3.0, 0.0, 0.0)), (make_body('tip'), (-2.0, 1.0, 0.25))])
    heights = two.under(np.array([3.0, -2.0, 0.5]), np.array([0.0, 1.0, 0.0]))[0]
    assert heights[0] == pytest.approx(0.0, abs=1e-9)
    assert heights[1] == pytest.approx(0.25, abs=1e-9)
    assert heights[2] > 1.0


def test_a_body_that_fills_its_grid_ends_at_its_rim():
    """A pad of 2 mm all of whose heights are given is not a plane: from its rim its wall rises by 1.5 a millimetre."""
    pad = Body.of_heights('pad', np.zeros((21, 21)))
    height, along_x, along_y = pad.under(np.array([0.9, 2.0, 0.0, 30.0]), np.array([0.0, 0.0, -1.2, 0.0]))
    assert height == pytest.approx([0.0, 1.5, 0.3, NO_BODY_MM], abs=1e-9)
    assert along_x == pytest.approx([0.0, 1.5, 0.0, 0.0], abs=1e-9)
    assert along_y == pytest.approx([0.0, 0.0, -1.5, 0.0], abs=1e-9)


def test_bodies_that_are_joined_do_not_reach_under_each_other():
    """Between two pads of 2 mm, 6 mm apart, there is none."""
    pad = Body.of_heights('pad', np.zeros((21, 21)))
    two = Body.joined('two', [(pad, (-4.0, 0.0, 0.0)), (pad, (4.0, 0.0, 0.0))])
    assert two.under(np.array([-4.0, 0.0, 4.0]), np.zeros(3))[0] == pytest.approx([0.0, NO_BODY_MM, 0.0], abs=1e-9)
