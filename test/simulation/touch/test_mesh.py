from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.mesh import body_of_mesh

trimesh = pytest.importorskip('trimesh')


def test_the_lower_side_of_a_mesh_is_what_the_gel_feels():
    sphere = trimesh.creation.icosphere(5, 2.0)
    body = body_of_mesh('sphere', sphere.vertices, sphere.faces)
    heights = body.under(np.array([0.0, 1.0]), np.array([0.0, 0.0]))[0]
    assert heights == pytest.approx([0.0, 2 - 3**0.5], abs=2e-3)


def test_a_tilted_mesh_touches_with_its_lower_side():
    box = trimesh.creation.box((6.0, 4.0, 2.0))
    body = body_of_mesh('box', box.vertices, box.faces, (0.0, 2.0))
    right, left = body.under(np.array([2.5, -2.5]), np.array([0.0, 0.0]))[0]
    assert left - right == pytest.approx(5 * np.tan(np.radians(2.0)), abs=2e-3)


def test_an_open_mesh_and_one_too_large_are_refused():
    box = trimesh.creation.box((6.0, 4.0, 2.0))
    with pytest.raises(ConfigurationError, match="the mesh 'open' is not closed; fill its holes"):
        body_of_mesh('open', box.vertices, box.faces[:-1])
    with pytest.raises(ConfigurationError, match='is 150 mm wide, more than 40; cut it, or scale it'):
        body_of_mesh('large', box.vertices * 25, box.faces)
