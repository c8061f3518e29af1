"""Shallow domes: heights and axes by hand."""

from pathlib import Path

import numpy as np
import pytest
from test_description import DOME

from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Dome, load_sensor


def test_the_surface_of_a_dome_is_a_part_of_a_sphere() -> None:
    """7 mm from the middle of a radius of 25: 24 mm above the centre, 1 mm lower than in the middle."""
    assert Dome(25.0).height_mm(np.array([[0.0, 0.0], [7.0, 0.0], [0.0, -7.0]])).tolist() == [0.0, -1.0, -1.0]


def test_the_axes_of_a_dome_lean_outwards() -> None:
    """There it falls by 7 in 24: out of the gel is (7, 0, 24) / 25, along it to the right (24, 0, -7) / 25."""
    along, aside, out = Dome(25.0).axes(np.array([7.0, 0.0])).T
    assert out == pytest.approx([0.28, 0.0, 0.96])
    assert along == pytest.approx([0.96, 0.0, -0.28])
    assert aside == pytest.approx([0.0, 1.0, 0.0])
    assert Dome(0.0).axes(np.array([7.0, 0.0])) == pytest.approx(np.eye(3))


def test_rays_meet_markers_below_the_dome(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(DOME)
    view = View(load_sensor(tmp_path / 'mine.yaml'))
    place = np.array([[5.0, -4.0], [-2.0, 6.0]])
    seen = view.below_seen_at(place, 0.7)
    flat = view.seen_at(np.column_stack([place, np.full(2, -0.7)]))
    assert (np.hypot(*(seen - 219.5).T) > np.hypot(*(flat - 219.5).T)).all()  # nearer to the lens
