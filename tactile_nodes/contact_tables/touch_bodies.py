"""Bodies by name: a family ('ring'), a radius ('ball:5'), a mesh file, heights, or a list of these that move as one."""

from __future__ import annotations

import io
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from tactile_nodes.errors import ConfigurationError, from_extra, in_a_line
from tactile_nodes.files import open_plain, read_plain
from tactile_nodes.simulation.indenter import BALL, PUNCH, number

if TYPE_CHECKING:
    from tactile_nodes.simulation.touch.body import Body

MESHES = '.stl', '.obj', '.ply'
HEIGHTS = '.npy'
LARGEST_BYTES = 64 << 20
ROUND = f'{BALL}:', f'{PUNCH}:'
STEEPEST_DEG = 20.0
"""Height maps cannot hold undercuts, so their tilt is limited; a mesh may be turned by any angle."""

FARTHEST_MM = 40.0

Tilt = tuple[float, float]
"""About x, then about y, in degrees."""


def body_of(named: object, tilt_deg: Tilt = (0.0, 0.0)) -> Body:
    """The named body, or the bodies of a list as one, tilted.

    Raises:
        ConfigurationError: there is no such family or file, the file does not hold a body, or its radius is none.
    """
    from tactile_nodes.simulation.touch.body import Body

    if isinstance(named, (list, tuple)):
        if not named:
            raise ConfigurationError('a list of bodies needs at least one, like: body: [{body: ring}]')
        return _tilted(Body.joined('several', [_part(each) for each in named]), tilt_deg)
    name = str(named)
    if is_mesh(name):
        return _mesh(Path(name), tilt_deg)
    if name.endswith(HEIGHTS):
        return _tilted(_heights(Path(name)), tilt_deg)
    return _tilted(_round(name) if name.startswith(ROUND) else _family(name), tilt_deg)


def is_mesh(name: str) -> bool:
    """Whether the file name has the suffix of a mesh."""
    return Path(name).suffix.lower() in MESHES


def _tilted(body: Body, tilt_deg: Tilt) -> Body:
    """A rotation about x raises the side of +y, and a rotation about y the side of -x, as for a mesh."""
    if not any(tilt_deg):
        return body
    if max(map(abs, tilt_deg)) > STEEPEST_DEG:
        raise ConfigurationError(
            f'{body.name} can be tilted by at most {STEEPEST_DEG:g} degrees, got {list(tilt_deg)}; only a mesh may be '
            'turned further'
        )
    return body.tilted(tilt_deg[1], -tilt_deg[0])


def _part(part: object) -> tuple[Body, tuple[float, float, float]]:
    """One body of a list, with its offset: right, down, raised."""
    if (
        isinstance(part, dict)
        and isinstance(part.get('body'), str)
        and not part.keys() - {'body', 'at_mm', 'raised_mm'}
    ):
        at_mm = part.get('at_mm', [0.0, 0.0])
        place = [*at_mm, part.get('raised_mm', 0.0)] if isinstance(at_mm, list) else []
        if len(place) == 3 and all(map(_is_near, place)):
            return body_of(part['body']), (float(place[0]), float(place[1]), float(place[2]))
    raise ConfigurationError(
        f'a body of a list must be like {{body: ring, at_mm: [3.0, 0.0], raised_mm: 0.1}}, within '
        f'{FARTHEST_MM:g} mm, got {part!r}'
    )


def _is_near(number: object) -> bool:
    return is_number(number) and abs(float(number)) <= FARTHEST_MM  # type: ignore[arg-type]


def is_number(value: object) -> bool:
    """Whether it is a finite number and not a bool."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _round(name: str) -> Body:
    """A ball, or a flat punch with sharp edges, by its radius in mm: 'ball:5'."""
    from tactile_nodes.simulation.touch.body import Body, grid
    from tactile_nodes.simulation.touch.families import ball

    shape, _, size = name.partition(':')
    radius_mm = number(size)
    if not 0 < radius_mm <= FARTHEST_MM / 2:
        raise ConfigurationError(
            f'{name} is not a body: {shape}: must be followed by a radius in mm above 0 and up to {FARTHEST_MM / 2:g}, '
            f'like {shape}:1.5'
        )
    x, y = grid(radius_mm + 1.0)
    flat = np.where(np.hypot(x, y) <= radius_mm, 0.0, np.inf)
    return Body.of_heights(name, ball(radius_mm, x, y) if shape == BALL else flat)


def _family(name: str) -> Body:
    from tactile_nodes.simulation.touch.families import FAMILIES, make_body

    if name not in FAMILIES:
        raise ConfigurationError(
            f'there is no contact {name!r}; give one of: {", ".join(FAMILIES)}, ball:5 or punch:1.5 (radius '
            f'in mm), a file: a mesh ({", ".join(MESHES)}), heights ({HEIGHTS}) or a description (.yaml); or, for a '
            'live launch, mixed'
        )
    return make_body(name)


def _mesh(file: Path, tilt_deg: Tilt) -> Body:
    from tactile_nodes.simulation.touch.mesh import body_of_mesh

    try:
        data = read_plain(file, LARGEST_BYTES)
    except OSError as error:
        raise _unreadable(file, error) from error
    with from_extra('mesh', f'reading {file}'):
        import trimesh
    kind = file.suffix.lower()
    try:
        mesh = trimesh.load_mesh(io.BytesIO(_in_utf8(data, kind)), file_type=kind[1:], process=True)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    except Exception as error:
        raise ConfigurationError(f'{file} cannot be read as a mesh ({in_a_line(error)}); export it again') from error
    return body_of_mesh(file.stem, vertices, faces, tilt_deg)


def _in_utf8(data: bytes, kind: str) -> bytes:
    """The contents of a mesh file as UTF-8 for trimesh. Only names can be invalid, and they are not used.

    Raises:
        ValueError: an STL file that is not text and does not have the length in its header.
    """
    faces = int.from_bytes(data[80:84], 'little')
    if kind == '.ply' or (kind == '.stl' and len(data) == 84 + 50 * faces):
        return data
    if kind == '.stl' and b'facet' not in data:
        raise ValueError(f'it is not text, and its length is not the {84 + 50 * faces} bytes that its header gives')
    return data.decode('utf-8', 'replace').encode()


def _heights(file: Path) -> Body:
    from tactile_nodes.simulation.touch.body import SPACING_MM, Body

    try:
        with open_plain(file, LARGEST_BYTES) as opened:
            heights = _array(opened)
    except OSError as error:
        raise _unreadable(file, error) from error
    except Exception as error:  # NumPy passes on any error of Python's parser
        raise ConfigurationError(
            f'{file} holds no array of heights, or is shorter than its header says; write it again with numpy.save'
        ) from error
    if heights.ndim != 2 or heights.dtype.kind not in 'fiu':
        raise ConfigurationError(f'{file} must hold a square of heights in mm, got {heights.dtype} {heights.shape}')
    wide_mm = max(heights.shape) * SPACING_MM
    if wide_mm > FARTHEST_MM + 1:
        raise ConfigurationError(
            f'{file} is {wide_mm:.0f} mm wide, at most {FARTHEST_MM:.0f} is allowed; cut it: heights are '
            f'{SPACING_MM:g} mm apart'
        )
    return Body.of_heights(file.stem, heights.astype(float))


def _array(file: BinaryIO) -> np.ndarray[Any, Any]:
    """All numbers of an .npy file; memory is allocated only if the file is long enough."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if (read_header := readers.get(np.lib.format.read_magic(file))) is None:
        raise ValueError('its version is not 1.0 or 2.0')
    shape, _, dtype = read_header(file)
    if math.prod(shape) * dtype.itemsize > os.fstat(file.fileno()).st_size - file.tell():
        raise ValueError('it is shorter than its header says')
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)


def _unreadable(file: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(f'cannot read the body {file} ({error.strerror}); check the path')
