from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.solution import Problem, Solution, problem_of, solve_problem

QUICK = Problem(finest_mm=0.1, growth=1.8, deepest_mm=0.4, rungs=4)


@pytest.fixture(scope='module')
def solution() -> Solution:
    return solve_problem(QUICK)


def test_a_solution_comes_back_from_its_arrays(solution: Solution):
    again = Solution.from_arrays(solution.to_arrays())
    np.testing.assert_array_equal(again.moved_mm, solution.moved_mm)
    assert again.key == QUICK.key


def test_gels_that_differ_in_modulus_and_markers_share_a_solution():
    one, two = (
        problem_of(Gel(mechanics='finite_strain', shear_modulus_mpa=g, seed=s)) for g, s in ((0.1, 1), (0.2, 2))
    )
    assert one.key == two.key
    assert one.key != problem_of(Gel(mechanics='finite_strain', soft_mm=4.0)).key
    assert one.key != problem_of(Gel(mechanics='finite_strain', contact='smooth')).key


def test_a_table_goes_through_the_rungs_of_the_ladder(solution: Solution):
    table = solution.table(0.2, steps=4)
    np.testing.assert_allclose(table.depth_mm, [0, 0.1, 0.2, 0.3, 0.4])
    rungs = [np.abs(solution.depth_mm - depth).argmin() for depth in table.depth_mm]
    np.testing.assert_allclose(table.force_n, 0.2 * solution.force_mm2[rungs], rtol=1e-9)


def test_points_on_nodes_move_as_the_nodes(solution: Solution):
    moved = solution.at(solution.across_mm[:5], solution.z_mm)
    np.testing.assert_allclose(moved, solution.moved_mm[:, :9:2, ::2], atol=1e-6)


def test_beyond_the_far_side_nothing_moves(solution: Solution):
    """It is bonded, 36 mm from the axis; the table of a layer of 12 mm goes on to 3.5 times that, 42 mm."""
    assert np.abs(solution.moved_mm[-1, -2]).max() > 0
    np.testing.assert_allclose(solution.at(np.array([36.0, 38.0, 42.0, 105.0]), solution.z_mm), 0, atol=1e-12)


def test_twice_as_light_a_touch_takes_hertzs_share_of_the_force(solution: Solution):
    table = solution.table(1.0, steps=40)
    assert table.force_at(0.1) / table.force_at(0.05) == pytest.approx(2**1.5, rel=0.1)


def test_a_tip_is_not_pressed_deeper_than_a_gel_is_thick():
    """A gel of 2 mm can be pressed by a tip, if not 2.5 mm deep; the depth for thicker gels stays 2.5 mm."""
    problem = problem_of(Gel(mechanics='finite_strain', soft_mm=1.7, skin_mm=0.3))
    solved = solve_problem(dataclasses.replace(problem, finest_mm=0.3, growth=2.0, rungs=4, reach_mm=12.0))
    assert solved.depth_mm[-1] == pytest.approx(1.8)
    assert (np.diff(solved.force_mm2) > 0).all()
    assert problem_of(Gel(mechanics='finite_strain', soft_mm=2.5, skin_mm=0.5)).deepest_mm == 2.5


def test_an_unknown_indenter_is_refused_by_name():
    with pytest.raises(ConfigurationError, match=r'spoon.*ball, punch'):
        problem_of(Gel(), 'spoon')
