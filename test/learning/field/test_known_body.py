"""The body that presses a gel to calibrate it: what it is called, and its lower side over the gel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.learning.calibrating.session import CalibrationSession, CalibrationSettings
from tactile_nodes.learning.field.body import KnownBody, body_of_card

LINE = np.arange(-40, 41) * 0.1
NODES = np.stack(np.meshgrid(LINE, LINE), -1)


def test_a_ball_and_a_punch_have_the_radius_that_is_given() -> None:
    away = np.hypot(*np.moveaxis(NODES, -1, 0))
    ball, punch = KnownBody.named('ball:3').over(NODES), KnownBody.named('punch:1.5').over(NODES)
    inner = away < 2.0  # a ball's walls are steeper than a body's may be from 2.5 mm on
    assert ball[inner] == pytest.approx(3 - np.sqrt(9 - np.square(away[inner])), abs=0.005)
    assert punch[away < 1.5] == pytest.approx(0.0, abs=1e-9)
    assert punch[away > 1.6].min() > 0.05


def test_a_closed_mesh_presses_where_it_is_lowest(tmp_path: Path) -> None:
    """A wedge 2 mm wide along x, lower by 1 mm towards +y."""
    trimesh = pytest.importorskip('trimesh')
    corners = [(x, y, z) for x in (-1, 1) for y, z in ((-1, 1), (1, 0), (-1, 3), (1, 3))]
    trimesh.convex.convex_hull(np.array(corners, float)).export(tmp_path / 'wedge.stl')
    body = KnownBody.named(str(tmp_path / 'wedge.stl'))
    height = body.over(NODES)
    assert height[40 + 8, 40] == pytest.approx(0.1, abs=0.06)
    assert height[40 - 8, 40] == pytest.approx(0.9, abs=0.06)
    assert (body.is_ball, body.card_name) == (False, 'wedge.stl')


def test_a_model_of_before_tells_the_radius_of_its_ball() -> None:
    assert body_of_card({'ball_mm': 0.6}, 'x').name == 'ball:0.6'
    assert body_of_card({'body': 'punch:1.5', 'ball_mm': 0.6}, 'x').name == 'punch:1.5'
    with pytest.raises(ModelError, match='model x does not say which body pressed; give the body that presses now'):
        body_of_card({}, 'x')


def test_beside_a_rig_a_body_goes_with_a_field_alone(tmp_path: Path) -> None:
    settings = CalibrationSettings(model='portable', gel='gel-7', body='punch:1.5', folder=str(tmp_path))
    with pytest.raises(ConfigurationError, match='need a model of any contact, such as field'):
        CalibrationSession(settings, lambda _: None)
