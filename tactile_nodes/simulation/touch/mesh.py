"""The lower side of a triangle mesh as heights, by rays from below."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.touch.body import SPACING_MM, Body, grid

MOST_FACES = 500_000
LARGEST_MM = 40.0
"""From the middle of its bounding box a body may reach half of this sideways."""


def body_of_mesh(
    name: str,
    vertices_mm: Float[np.ndarray, 'vertices 3'],
    faces: Int[np.ndarray, 'faces 3'],
    tilt_deg: tuple[float, float] = (0.0, 0.0),
) -> Body:
    """What a gel under a closed mesh feels of it; z of the mesh points away from the gel.

    The middle of its bounding box becomes the body's origin. `tilt_deg` turns it about x, then about y.

    Raises:
        ConfigurationError: the mesh is not closed, is too large or has too many faces.
    """
    import trimesh  # only where somebody gives a mesh
    from scipy.spatial.transform import Rotation

    if len(faces) > MOST_FACES:
        raise ConfigurationError(f'the mesh {name!r} has {len(faces)} faces, more than {MOST_FACES}; simplify it')
    mesh = trimesh.Trimesh(vertices_mm @ Rotation.from_euler('xy', tilt_deg, degrees=True).as_matrix().T, faces)
    if not mesh.is_watertight:
        raise ConfigurationError(f'the mesh {name!r} is not closed; fill its holes')
    low, high = mesh.bounds
    half_mm = float((high - low)[:2].max()) / 2
    if half_mm > LARGEST_MM / 2:
        raise ConfigurationError(
            f'the mesh {name!r} is {2 * half_mm:.0f} mm wide, more than {LARGEST_MM:.0f}; cut it, or scale it: '
            'meshes are in millimetres'
        )
    mesh.apply_translation(-(low + high) / 2)
    return Body.of_heights(name, _lower_side(mesh, half_mm))


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
