"""What the sides of a gel add to the motion under a tip: from patch to patch, by hand."""

import dataclasses

import numpy as np
import pytest
from test_axisymmetric import readout, response

from tactile_nodes.sensing.elasticity.patches import PatchGrid
from tactile_nodes.sensing.explain.arrays import readout_arrays, readout_from
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.geometry import BinGrid


@pytest.fixture
def by_sides() -> BySides:
    """2x4 patches of 2 mm; the motion along x of the second of two regions is 10 in row 0 and 30 in row 1, plus col."""
    per_n = np.zeros((8, 2, 2), np.float32)
    per_n[:, 1, 0] = [10, 11, 12, 13, 30, 31, 32, 33]
    return BySides(PatchGrid(BinGrid(1, 2, 8.0, 4.0)), per_n)


def test_motion_is_linear_between_the_middles_of_patches(by_sides: BySides):
    """The middles are at x = -3, -1, 1, 3 and y = -1, 1 mm. Beyond the outermost ones it stays as it is."""
    contacts = np.array([[-2.0, 0.0, 1.0], [3.0, 1.0, 0.5], [9.0, -9.0, 2.0]])
    motion, slopes = by_sides.motion_and_slopes(contacts)
    assert motion[:, 1, 0].tolist() == pytest.approx([20.5, 0.5 * 33, 2 * 13])
    assert not motion[:, 0].any()
    assert slopes[:, 0, 1, 0].tolist() == pytest.approx([0.5, 10.0, 20.5])


def test_a_part_of_the_regions(by_sides: BySides):
    contacts = np.array([[0.3, 0.4, 0.7]])
    whole, _ = by_sides.motion_and_slopes(contacts)
    part, _ = by_sides.of_regions(np.array([1])).motion_and_slopes(contacts)
    assert part[:, 0].tolist() == whole[:, 1].tolist()


def test_a_response_with_sides_compiled_has_the_same_motion_and_slopes_and_is_read_back_from_a_file():
    regions = np.random.default_rng(2).normal(size=(324, 64, 2)).astype(np.float32)
    sides = BySides(PatchGrid(BinGrid()), regions)
    plain = dataclasses.replace(response(), sides=sides)
    contacts = np.array([[1.3, -4.2, 0.4], [15.9, 6.1, 0.9]])
    for one, other in zip(
        plain.motion_slopes_and_columns(contacts),
        dataclasses.replace(plain, compiled=True).motion_slopes_and_columns(contacts),
        strict=True,
    ):
        assert other == pytest.approx(one, abs=1e-6)
    step = 1e-5 * np.eye(3)[0]
    measured = (plain.motion(contacts[:1] + step) - plain.motion(contacts[:1] - step)) / 2e-5
    assert plain.motion_and_slopes(contacts[:1])[1][0] == pytest.approx(measured, abs=1e-3)
    arrays, entries = readout_arrays(readout(response=plain))
    again = readout_from(arrays, entries, BinGrid()).response
    assert again.sides.per_n == pytest.approx(regions, abs=2e-3)
