"""The bench of flow methods: what it counts as true, and how it scores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.flow import cases as flow_cases
from benchmarks.flow.errors import Errors, by_region
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.flow.methods import DisplacementField


def test_motion_apart_is_largest_at_its_reach() -> None:
    """Hand calculation: most * exp(0.5 - 0.5) at the reach, 0 at the centre, pointing outwards."""
    offset = np.array([[[0.0, 0.0], [40.0, 0.0], [0.0, -40.0], [80.0, 0.0]]], np.float32)
    found = flow_cases.apart(offset, 6.0, 40.0)[0]
    np.testing.assert_allclose(found[:3], [[0, 0], [6, 0], [0, -6]], atol=1e-5)
    assert found[3, 0] == pytest.approx(12 * np.exp(-1.5), abs=1e-5)


def test_a_perfect_method_scores_no_error_and_slope_one() -> None:
    truth = np.array([[1.0, 0.0], [0.0, -2.0]])
    summary = Errors([np.zeros((2, 2))], [truth], [np.ones(2, bool)], [3.0]).by_belief()
    assert (summary['rms_px'], summary['slope'], summary['far_share'], summary['cpu_ms']) == (0, 1, 0, 3)


def test_half_the_motion_is_slope_a_half_and_what_is_not_believed_is_reported_apart() -> None:
    truth = np.array([[4.0, 0.0], [0.0, 0.4]])
    summary = Errors([-truth / 2], [truth], [np.array([False, True])], [1.0]).by_belief()
    assert summary['slope'] == pytest.approx(0.5)
    assert (summary['far_share'], summary['believed_far_share']) == (0.5, 0)


def test_dense_fields_are_averaged_by_region_and_patches_are_taken_as_they_are() -> None:
    dense = np.zeros((80, 80, 2), np.float32)
    dense[:2, :1] = (1.0, 2.0)  # half of the first region
    np.testing.assert_array_equal(by_region(DisplacementField(dense), 40)[0][0, 0], [0.5, 1.0])
    patches = np.ones((10, 10, 2), np.float32)
    assert by_region(DisplacementField(patches), 40)[0].shape == (10, 10, 2)


def test_a_folder_without_speckle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r'there is no speckle image .* give --speckle the folder'):
        flow_cases.known_shifts(tmp_path)
