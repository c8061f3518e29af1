"""Bins over a part of the gel: what they say in models, messages and truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from described_chain import DescribedChain, model_of, sensor_of

from tactile_nodes import conversions
from tactile_nodes.errors import ModelError
from tactile_nodes.learning.datasets.labels import outside
from tactile_nodes.messages import types
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.reading import require_central
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.sensors import BinSettings, GelDescription, ImageSettings
from tactile_nodes.simulation.optics import Press
from tactile_nodes.simulation.touch.table import over_bins
from tactile_nodes.viewing.force_shapes import force_points

ASIDE = sensor_of(
    'aside', ImageSettings(320, 240, 320, 240), GelDescription(30.0, 20.0, (4.0,), (0.1,), (0.49,), (0.5, 2.0), 0.0),
    9000, BinSettings(4, 6, 15.0, 10.0, (3.0, -1.0)), middle_mm=(3.0, -1.0),
)  # fmt: skip
"""16x12 mm are seen of 30x20, about (3, -1) mm; bins of 2.5 mm over most of that."""


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return model_of(ASIDE, tmp_path_factory.mktemp('described'))


def test_bins_of_a_model_lie_where_the_description_has_them(made: LoadedModel) -> None:
    """From 3 - 7.5 and -1 - 5 on, 2.5 mm each."""
    assert made.model.bins == BinGrid(4, 6, 15.0, 10.0, (3.0, -1.0))
    assert made.model.bins.origin_mm == (-4.5, -6.0)
    assert made.model.bins.centres_mm[0, 0].tolist() == [-3.25, -4.75]
    assert made.model.bins.bin_of(3.1, -0.9) == 2 * 6 + 3


def test_presses_are_reported_where_they_are_on_the_gel(made: LoadedModel) -> None:
    chain = DescribedChain(ASIDE, made)
    for place_mm in ((3.0, -1.0), (6.4, 1.1), (-1.5, -3.0)):
        read = chain.read(Press(*place_mm, 0.7))
        assert read.total_n == pytest.approx(chain.table.force_at(0.7), rel=0.2)
        assert np.hypot(read.contacts[0].x_mm - place_mm[0], read.contacts[0].y_mm - place_mm[1]) < 0.5
        strongest = divmod(int(read.normal_force_n.argmax()), 6)
        assert np.abs(made.model.bins.centres_mm[strongest] - place_mm).max() < 1.5


def test_messages_and_views_say_where_bins_begin(made: LoadedModel) -> None:
    forces = np.zeros((4, 6), np.float32)
    forces[0, 5] = 2.0
    message = types.ForceDistribution(**conversions.force_fields(forces, made.model.bins))
    assert (message.origin.x, message.origin.y) == pytest.approx((-0.0045, -0.006))
    # 2 N into the gel at (9.25, -4.75) mm: torque (-y f, x f, 0).
    assert (message.wrench.torque.x, message.wrench.torque.y) == pytest.approx((0.0095, 0.0185))
    points = np.asarray(force_points(message).data).view('<f4').reshape(4, 6, 4)
    assert points[0, 5].tolist() == pytest.approx([0.00925, -0.00475, 0.0, 2.0])


def test_a_force_at_a_border_is_shared_by_the_bins_beside_it() -> None:
    """x = 3 mm is the border between columns 2 and 3, y = -2.25 mm the middle of row 1."""
    bins, place_mm, force = BinGrid(4, 6, 15.0, 10.0, (3.0, -1.0)), np.array([[3.0, -2.25]]), np.eye(3)[2:]
    found = over_bins(place_mm, force, 1.0, bins)
    assert found[1, 2, 2] == found[1, 3, 2] == pytest.approx(0.5)


def test_what_lies_off_the_bins_is_outside() -> None:
    bins = BinGrid(4, 6, 15.0, 10.0, (3.0, -1.0))
    assert not outside(10.4, 3.9, bins)
    assert all(outside(x, y, bins) for x, y in ((10.6, 0.0), (-4.6, 0.0), (0.0, 4.1)))


def test_a_card_has_a_centre_only_where_it_is_not_the_origin() -> None:
    assert BinGrid().card == {'rows': 9, 'cols': 9, 'width_mm': 32.0, 'height_mm': 32.0}
    aside = BinGrid(4, 6, 15.0, 10.0, (3.0, -1.0))
    assert BinGrid.of_card(aside.card) == aside


def test_a_readout_of_tips_refuses_bins_aside() -> None:
    with pytest.raises(ModelError, match=r'centred at \(3.0, -1.0\) mm; set bins.centre_mm to 0'):
        require_central(BinGrid(4, 6, 15.0, 10.0, (3.0, -1.0)))


def test_the_model_is_kept_with_its_bins(made: LoadedModel, tmp_path: Path) -> None:
    assert made.card['bins']['centre_mm'] == [3.0, -1.0]
