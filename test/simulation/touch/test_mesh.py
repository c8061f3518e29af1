from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.mesh import body_of_mesh


@pytest.fixture
def trimesh() -> ModuleType:
    return pytest.importorskip('trimesh')


def test_the_lower_side_of_a_mesh_is_what_the_gel_feels(trimesh: ModuleType):
    sphere = trimesh.creation.icosphere(5, 2.0)
    body = body_of_mesh('sphere', sphere.vertices, sphere.faces)
    heights = body.under(np.array([0.0, 1.0]), np.array([0.0, 0.0]))[0]
    assert heights == pytest.approx([0.0, 2 - 3**0.5], abs=2e-3)


def test_a_tilted_mesh_touches_with_its_lower_side(trimesh: ModuleType):
    box = trimesh.creation.box((6.0, 4.0, 2.0))
    body = body_of_mesh('box', box.vertices, box.faces, (0.0, 2.0))
    right, left = body.under(np.array([2.5, -2.5]), np.array([0.0, 0.0]))[0]
    assert left - right == pytest.approx(5 * np.tan(np.radians(2.0)), abs=2e-3)


def test_beside_a_box_there_is_no_body(trimesh: ModuleType):
    """From the walls of a box of 6 mm, 3 mm from its middle, its height rises by no less than 1.5 a millimetre."""
    box = trimesh.creation.box((6.0, 6.0, 2.0))
    heights = body_of_mesh('box', box.vertices, box.faces).under(np.array([2.5, 4.0, 20.0]), np.zeros(3))[0]
    assert heights[0] == pytest.approx(0.0, abs=1e-9)
    assert heights[1] > 1.2
    assert heights[2] > 3.9


@pytest.mark.parametrize(
    ('faces', 'scale', 'said'),
    [
        (slice(0, -1), 1.0, 'is not closed: 3 of its edges do not join two triangles; fill its holes'),
        (slice(0, 0), 1.0, 'holds no triangles; export it again'),
        (slice(None), 25.0, 'is 150 mm wide, more than 40; cut it, or scale it: meshes are in millimetres'),
        (slice(None), 1e-3, 'is 0.006 mm wide, less than 0.4; scale it: meshes are in millimetres'),
    ],
)
def test_a_mesh_that_is_open_empty_too_large_or_in_metres_is_refused(
    trimesh: ModuleType, faces: slice, scale: float, said: str
):
    box = trimesh.creation.box((6.0, 4.0, 2.0))
    with pytest.raises(ConfigurationError, match=said):
        body_of_mesh('box', box.vertices * scale, box.faces[faces])


def test_two_boxes_that_share_an_edge_are_told_apart_from_one_with_a_hole(trimesh: ModuleType):
    one, other = trimesh.creation.box((4.0, 4.0, 4.0)), trimesh.creation.box((4.0, 4.0, 4.0))
    both = trimesh.util.concatenate([one, other.apply_translation((4.0, 4.0, 0.0))])
    both.merge_vertices()
    with pytest.raises(ConfigurationError, match='1 of its edges do not join two triangles; fill its holes'):
        body_of_mesh('boxes', both.vertices, both.faces)


def test_triangles_that_have_collapsed_to_a_line_do_not_open_a_mesh(trimesh: ModuleType):
    """As exports round them: two corners of such a triangle are at the same place."""
    box = trimesh.creation.box((6.0, 4.0, 2.0))
    vertices, (one, other) = np.vstack([box.vertices, box.vertices[box.edges[0, 1]]]), box.edges[0]
    faces = np.vstack([box.faces, [one, other, len(box.vertices)]])
    expected = body_of_mesh('box', box.vertices, box.faces)
    assert np.array_equal(body_of_mesh('box', vertices, faces).height_mm, expected.height_mm)
