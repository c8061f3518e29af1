"""Regions are found together with the smooth functions that they scatter about."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.learning.axisymmetric.steps import Equations
from tactile_nodes.learning.transfer.regions import Smooth

REGIONS, NUMBERS, TERMS = 5, 3, 2


def spd(random: np.random.Generator, *shape: int) -> np.ndarray:
    """Positive definite matrices."""
    root = random.normal(size=(*shape, shape[-1]))
    return np.asarray(root @ np.swapaxes(root, -1, -2) + np.eye(shape[-1]))


def test_what_is_common_is_found_with_the_regions() -> None:
    """By hand: 2 s + m = 4 and s + 3 m = 5 are solved by s = 1.4, m = 1.2."""
    one = np.ones(1)
    equations = Equations(
        2 * np.ones((1, 1, 1)), 4 * np.ones((1, 1)), np.ones((1, 1, 1)), 3 * np.ones((1, 1)), 5 * one, np.inf * one
    )
    step, move = equations.solved()
    assert step.ravel() == pytest.approx([1.4])
    assert move == pytest.approx([1.2])


def test_regions_follow_a_common_step_that_is_cut_short() -> None:
    """By hand: with m held at 1, 2 s = 4 - 1."""
    one = np.ones(1)
    equations = Equations(
        2 * np.ones((1, 1, 1)), 4 * np.ones((1, 1)), np.ones((1, 1, 1)), 3 * np.ones((1, 1)), 5 * one, one
    )
    step, move = equations.solved()
    assert move == pytest.approx([1.0])
    assert step.ravel() == pytest.approx([1.5])


def test_a_step_is_that_of_all_unknowns_at_once() -> None:
    """The same quadratic, written out in all its unknowns and solved as one matrix."""
    random = np.random.default_rng(2)
    square, down = spd(random, REGIONS, NUMBERS), random.normal(size=(REGIONS, NUMBERS))
    cross, across, along = 0.1 * random.normal(size=(REGIONS, NUMBERS, 1)), np.array([[9.0]]), np.array([0.7])
    here, precision = random.normal(size=(REGIONS, NUMBERS)), spd(random, REGIONS, NUMBERS)
    over, terms, expected = (
        random.normal(size=size) for size in ((REGIONS, TERMS), (TERMS, NUMBERS), (TERMS, NUMBERS))
    )
    smooth = Smooth(over, terms, expected, spd(random, NUMBERS))

    def slope(unknown: np.ndarray) -> np.ndarray:
        """Of half the misfit, by the steps of regions, of what is shared, and of the terms."""
        step, shared = unknown[: REGIONS * NUMBERS].reshape(REGIONS, NUMBERS), unknown[REGIONS * NUMBERS]
        now = terms + unknown[REGIONS * NUMBERS + 1 :].reshape(TERMS, NUMBERS)
        pull = np.einsum('rij,rj->ri', precision, here + step - over @ now)
        by_step = np.einsum('rij,rj->ri', square, step) + cross[..., 0] * shared - down + pull
        by_shared = across[0] * shared + (cross[..., 0] * step).sum() - along
        by_terms = -over.T @ pull + (now - expected) @ smooth.precision
        return np.concatenate([by_step.ravel(), by_shared, by_terms.ravel()])

    count = REGIONS * NUMBERS + 1 + TERMS * NUMBERS
    at_nothing = slope(np.zeros(count))
    whole = np.column_stack([slope(unit) - at_nothing for unit in np.eye(count)])
    wanted = np.linalg.solve(whole, -at_nothing)

    equations = Equations(square, down, cross, across, along, np.array([np.inf]))
    step, move = smooth.step(equations, here, precision)
    assert step.ravel() == pytest.approx(wanted[: REGIONS * NUMBERS])
    assert move == pytest.approx(wanted[REGIONS * NUMBERS :])
    assert smooth.moved(move[1:]).terms.ravel() == pytest.approx(terms.ravel() + wanted[REGIONS * NUMBERS + 1 :])
