"""The lightest touches that the default model has to find, in rendered pictures."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes import conversions
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.messages import types
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.following import Following, FollowingParams
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

FORCE = types.ForceDistribution
NS_PER_FRAME = 16_666_667


def test_every_touch_of_20_mn_is_found_as_a_tip_and_none_where_nothing_touches() -> None:
    """docs/results/accuracy.md: all touches of 20 mN and more are to be found. Its nominal error is 5 mN."""
    gel, params = Gel(), FollowingParams(model='field', reference_frames=12)
    table, crop = contact_table(gel), Crop.centred(gel.image_width, gel.image_height, 440, 440)
    optics, following, estimating = Optics(gel, table), Following(params), Estimating('field')
    following.begin_capture()
    number = 0

    def read(*presses: Press) -> types.ForceDistribution:
        nonlocal number
        number += 1
        picture = np.ascontiguousarray(crop.apply(optics.render(presses, number)))
        features = following.answer(picture, conversions.header(number * NS_PER_FRAME, ''))
        return estimating.answer(features, '', 1.0, 0.0)

    for _ in range(params.reference_frames):
        read()
    for place in np.random.default_rng(7).uniform(-12, 12, (10, 2)):
        force = read(Press(*place.tolist(), table.depth_at(0.02)))
        assert force.explanation == FORCE.EXPLANATION_TIPS
        assert force.total == pytest.approx(0.02, abs=0.005)
        assert 1e3 * np.array([force.contact.x, force.contact.y]) == pytest.approx(place, abs=0.5)
        assert read().total == 0.0
