"""Height map of the lower side of a triangle mesh, by rays from below."""

from __future__ import annotations

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Float, Int
from tactile_nodes.simulation.touch.body import SPACING_MM, Body, grid

MOST_FACES = 500_000
SMALLEST_MM, LARGEST_MM = 0.4, 40.0
"""Least and greatest width of a mesh, along x or y; the gel's surface is computed on a grid of 0.4 mm."""


def body_of_mesh(
    name: str,
    vertices_mm: Float[np.ndarray, 'vertices 3'],
    faces: Int[np.ndarray, 'faces 3'],
    tilt_deg: tuple[float, float] = (0.0, 0.0),
) -> Body:
    """The lower side of a closed mesh as a body; z of the mesh points away from the gel.

    The middle of its bounding box becomes the body's origin. `tilt_deg` turns it about x, then about y.

    Raises:
        ConfigurationError: the mesh is empty or not closed, is too small or too large, or has too many faces.
    """
    import trimesh  # imported here: only meshes need it
    from scipy.spatial.transform import Rotation

    if len(faces) > MOST_FACES:
        raise ConfigurationError(f'the mesh {name!r} has {len(faces)} faces, more than {MOST_FACES}; simplify it')
    mesh = trimesh.Trimesh(vertices_mm @ Rotation.from_euler('xy', tilt_deg, degrees=True).as_matrix().T, faces)
    one, two, three = mesh.faces.T
    mesh.update_faces((one != two) & (two != three) & (three != one))  # else triangles that are lines open the mesh
    _require_closed(name, mesh.edges_sorted)
    low, high = mesh.bounds
    wide_mm = float((high - low)[:2].max())
    if not SMALLEST_MM <= wide_mm <= LARGEST_MM:
        beside = f'less than {SMALLEST_MM:g}; ' if wide_mm < SMALLEST_MM else f'more than {LARGEST_MM:g}; cut it, or '
        raise ConfigurationError(
            f'the mesh {name!r} is {wide_mm:.3g} mm wide, {beside}scale it: meshes are in millimetres'
        )
    mesh.apply_translation(-(low + high) / 2)
    return Body.of_heights(name, _lower_side(mesh, wide_mm / 2))


def _require_closed(name: str, edges: Int[np.ndarray, 'edges 2']) -> None:
    """Check that two triangles meet at each edge; `edges` holds each edge once per triangle."""
    if not len(edges):
        raise ConfigurationError(f'the mesh {name!r} holds no triangles; export it again')
    sides = np.unique(edges, axis=0, return_counts=True)[1]
    if apart := np.count_nonzero(sides != 2):
        raise ConfigurationError(
            f'the mesh {name!r} is not closed: {apart} of its edges do not join two triangles; fill its holes, and '
            'join bodies that touch'
        )


def _lower_side(mesh: object, half_mm: float) -> Float[np.ndarray, 'n n']:
    x, y = grid(half_mm + SPACING_MM)
    # A ray along a side of triangles may slip between two of them.
    start = np.column_stack([x.ravel() + 1e-5, y.ravel() + 2e-5, np.full(x.size, -1e3)])
    places, rays, _ = mesh.ray.intersects_location(  # type: ignore[attr-defined]
        start, np.tile([0.0, 0.0, 1.0], (len(start), 1)), multiple_hits=False
    )
    heights = np.full(x.size, np.inf)
    heights[rays] = places[:, 2]
    return heights.reshape(x.shape)
