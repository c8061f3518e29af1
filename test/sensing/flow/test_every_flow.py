"""What every method owes that follows a texture: at rest nothing moves, and each answer is of its image alone."""

from __future__ import annotations

import numpy as np
import pytest
from shifting import shifted

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.methods import FlowMethod

AT_REST_PX = {'dis': 0.0, 'inverse_compositional': 1e-4}


@pytest.fixture(params=AT_REST_PX)
def method(request: pytest.FixtureRequest) -> str:
    return request.param


def flow_of(method: str, rest: np.ndarray) -> FlowMethod:
    flow = make_flow(method)
    flow.set_reference(rest)
    return flow


def test_the_rest_image_against_itself_does_not_move_and_is_copied(method: str, speckle: np.ndarray):
    buffer = speckle.copy()
    flow = flow_of(method, buffer)
    buffer[:] = 0
    np.testing.assert_allclose(flow.displacement(speckle).displacement_px, 0, atol=AT_REST_PX[method])


def test_what_was_seen_before_does_not_change_a_bit(method: str, speckle: np.ndarray):
    image = shifted(speckle, 0.7, 0.3)
    fresh, used = flow_of(method, speckle), flow_of(method, image)
    used.displacement(shifted(speckle, 9.0, -5.0))
    used.set_reference(speckle)
    used.displacement(shifted(speckle, -3.0, 2.0))
    np.testing.assert_array_equal(used.displacement(image).displacement_px, fresh.displacement(image).displacement_px)


def test_later_calls_leave_earlier_results_alone(method: str, speckle: np.ndarray):
    flow = flow_of(method, speckle)
    first = flow.displacement(shifted(speckle, 1.0, 0.0))
    kept = first.displacement_px.copy()
    flow.displacement(shifted(speckle, -2.0, 1.0))
    np.testing.assert_array_equal(first.displacement_px, kept)


def test_an_image_of_another_size_is_refused(method: str, speckle: np.ndarray):
    with pytest.raises(ImageError, match='has 400x440 pixels but the rest image 440x440'):
        flow_of(method, speckle).displacement(np.ascontiguousarray(speckle[:, :400]))


def test_flow_without_a_rest_image_says_what_is_missing(method: str, speckle: np.ndarray):
    with pytest.raises(ImageError, match='no rest image'):
        make_flow(method).displacement(speckle)
