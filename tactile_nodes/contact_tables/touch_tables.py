"""Contacts of bodies with a gel, by name: the bodies, their motion, and the solved tables.

A contact is named by a family ('ring'), a ball or punch with its radius in mm ('ball:5'), a mesh (STL, OBJ, PLY in
millimetres), a height map (NPY: a square array of heights in millimetres, with a spacing of 0.1 mm), or a YAML file
with more entries::

    body: gripper_pad.stl        # or ring, ball:5, heights; a list of {body: ring, at_mm: [3.0, 0.0], raised_mm: 0.1}
    tilt_deg: [0.0, 2.0]         # about x, then about y
    force_n: 2.0                 # or depth_mm: 0.5
    drag_mm: 0.6
    drag_deg: 0.0                # direction of the drag, from x towards y
    twist_deg: 10.0
    friction: 0.6
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_nodes import paths
from tactile_nodes.contact_tables.touch_bodies import HEIGHTS, LARGEST_BYTES, body_of, is_mesh, is_number
from tactile_nodes.errors import ConfigurationError, in_a_line
from tactile_nodes.files import read_text
from tactile_nodes.npz_files import read_npz, write_npz
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.touch.table import TouchTable, table_steps_mm

if TYPE_CHECKING:
    from tactile_nodes.simulation.touch.body import Body
    from tactile_nodes.simulation.touch.bricks import Layer
    from tactile_nodes.simulation.touch.track import Way

CELLS, CELL_MM = 120, 0.4
"""Cells of the layer on which contacts are solved: 48 mm wide, and periodic."""

USUAL = 'ring', 'edge', 'two'
USUAL_MM2 = 18.0
"""The contacts that a live scene shows among its presses, and their force divided by the shear modulus."""

BOUNDS = {
    'tilt_deg': (-180.0, 180.0),
    'force_n': (0.001, 100.0),
    'depth_mm': (0.0, 5.0),
    'drag_mm': (0.0, 5.0),
    'drag_deg': (-360.0, 360.0),
    'twist_deg': (-90.0, 90.0),
    'friction': (0.0, 10.0),
}

Tell = Callable[[int, int], None]


@dataclass(frozen=True)
class Contact:
    """The pressing body and its motion. Angles in degrees; a depth replaces the force."""

    body: object
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    force_n: float = 2.0
    depth_mm: float = 0.0
    drag_mm: float = 0.6
    drag_deg: float = 0.0
    twist_deg: float = 0.0
    friction: float = 0.6

    def __post_init__(self) -> None:
        for name, (low, high) in BOUNDS.items():
            number = getattr(self, name)
            if not all(low <= each <= high for each in (number if isinstance(number, tuple) else (number,))):
                raise ConfigurationError(f"a contact's {name!r} must be from {low:g} to {high:g}, got {number!r}")

    @classmethod
    def named(cls, name: str) -> Contact:
        """A contact by the name of a family or body, mesh, height map or YAML file.

        Raises:
            ConfigurationError: there is no such file, or it holds an unknown entry.
        """
        return _described(Path(name)) if name.endswith(('.yaml', '.yml')) else cls(name)


def solved_contact(gel: Gel, contact: Contact, tell: Tell | None = None) -> TouchTable:
    """The table of a contact with a gel: shipped with the package, from the cache, or solved and cached if possible.

    Solving takes some ten seconds. `tell` is called with the number of finished stages and the total.

    Raises:
        ConfigurationError: the contact is unknown or cannot be solved.
    """
    problem = _problem(gel, contact)
    found = known_table(problem.key)
    return _solved(gel, problem, tell) if found is None else found


def first_solved(gel: Gel, body: Body, ways: Sequence[Way]) -> TouchTable:
    """The table of the first of some paths of a body that can be solved; from the cache if it was solved before.

    Raises:
        ConfigurationError: none can be solved: there is too much strain, or the body hardly touches.
    """
    problems = [_problem_of(gel, body, way) for way in ways]
    for problem in problems:
        if (known := known_table(problem.key)) is not None:
            return known
    for problem in problems:
        with suppress(ConfigurationError):
            return _solved(gel, problem)
    raise ConfigurationError(f'the body {body.name} cannot be pressed into this gel at any force')


def random_ways(random: np.random.Generator, gel: Gel, force_n: float, lightest_n: float) -> list[Way]:
    """A random path, mostly dragged and sometimes twisted: to a force, and in case that cannot be solved, to others.

    These are halves of the force, down to a quarter of the lightest, then two and four times the force.
    """
    from tactile_nodes.simulation.touch.track import Way

    dragged, twisted = bool(random.uniform() < 0.75), bool(random.uniform() < 0.3)
    drag_mm, drag_rad = float(random.uniform(0.05, 0.8)), float(random.uniform(0, math.tau))
    twist_rad, friction = float(random.uniform(-0.15, 0.15)), float(random.uniform(0.3, 0.9))
    forces_n = [force_n]
    while forces_n[-1] / 2 > lightest_n / 4:
        forces_n.append(forces_n[-1] / 2)
    return [
        Way(
            force_mm2=round(each / gel.shear_modulus_mpa, 6), drag_mm=drag_mm * dragged, drag_rad=drag_rad,
            twist_rad=twist_rad * (dragged and twisted), friction=friction, press_stages=2, drag_stages=2,
        )
        for each in (*forces_n, 2 * force_n, 4 * force_n)
    ]  # fmt: skip


def ready_contacts(gel: Gel) -> dict[str, TouchTable]:
    """The usual contacts of a live scene that fit on the gel and are already solved.

    Their force is 18 mm² times the shear modulus of the gel.
    """
    usual = ((name, usual_contact(gel, name)) for name in USUAL if 2 * body_of(name).reach_mm <= min(gel.sides_mm))
    found = ((name, known_table(_problem(gel, contact).key)) for name, contact in usual)
    return {name: table for name, table in found if table is not None}


def usual_contact(gel: Gel, name: str) -> Contact:
    """The shipped contact: 2 N on the paper's gel, scaled by the modulus, so that gels of its thickness share it."""
    return Contact(name, force_n=USUAL_MM2 * gel.shear_modulus_mpa)


class _Problem(NamedTuple):
    """The inputs of a table, and its name in the cache."""

    layer: Layer
    body: Body
    way: Way
    key: str


def _problem(gel: Gel, contact: Contact) -> _Problem:
    body = body_of(contact.body, contact.tilt_deg)
    wide_mm, narrow_mm = 2 * body.reach_mm, min(gel.sides_mm)
    if wide_mm > narrow_mm:
        raise ConfigurationError(
            f'{body.name} is {wide_mm:.0f} mm wide about its origin, but the gel only {narrow_mm:g} mm; give a smaller '
            'body, or place it nearer to the middle'
        )
    return _problem_of(gel, body, _way(contact, gel))


def _problem_of(gel: Gel, body: Body, way: Way) -> _Problem:
    from tactile_nodes.simulation.touch.bricks import Layer
    from tactile_nodes.simulation.touch.track import track_key

    layer = Layer(CELLS, CELL_MM, gel.layer_mm)
    return _Problem(layer, body, way, table_key(track_key(layer, body, way), gel))


def _solved(gel: Gel, problem: _Problem, tell: Tell | None = None) -> TouchTable:
    """Solve a problem, and keep its table in the cache if that can be written."""
    from tactile_nodes.simulation.touch.bricks import Bricks
    from tactile_nodes.simulation.touch.track import solve_track

    track = solve_track(Bricks(problem.layer), problem.body, problem.way, tell, gel.shear_modulus_mpa)
    table = TouchTable.of_track(track, -gel.skin_mm)
    with suppress(OSError, ConfigurationError):
        write_table(paths.cache_directory() / 'touches' / f'{problem.key}.npz', table)
    return table


def table_key(track: str, gel: Gel) -> str:
    """The name of the table of a track on a gel."""
    spacing_mm, _ = table_steps_mm(-gel.skin_mm)
    return f'{track}-{gel.skin_mm:g}-{spacing_mm:g}'


def known_table(key: str) -> TouchTable | None:
    """The table with a key if it is shipped or in the cache, else None."""
    if (shipped := _read(paths.share_directory() / 'config' / 'touches' / f'{key}.npz')) is not None:
        return shipped
    with suppress(OSError, ConfigurationError):
        return _read(paths.cache_directory() / 'touches' / f'{key}.npz')
    return None


def write_table(file: Path, table: TouchTable) -> None:
    """Write a table. Raises the errors of `write_npz`."""
    write_npz(file, table.to_arrays(), compressed=True)


def _read(file: Path) -> TouchTable | None:
    """The table in a file, if there is one and it is not damaged."""
    arrays = read_npz(file, LARGEST_BYTES)
    with suppress(KeyError, TypeError, ValueError):
        return None if arrays is None else TouchTable.from_arrays(arrays)
    return None


def _way(contact: Contact, gel: Gel) -> Way:
    from tactile_nodes.simulation.touch.track import Way

    return Way(
        force_mm2=round(contact.force_n / gel.shear_modulus_mpa, 6),
        depth_mm=contact.depth_mm,
        drag_mm=contact.drag_mm,
        drag_rad=math.radians(contact.drag_deg),
        twist_rad=math.radians(contact.twist_deg),
        friction=contact.friction,
        press_stages=3,
        drag_stages=3,
    )


def _described(file: Path) -> Contact:
    """The contact that a YAML file describes."""
    import yaml

    try:
        entries = yaml.safe_load(read_text(file))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = in_a_line(getattr(error, 'strerror', None) or error)
        raise ConfigurationError(f'cannot read the contact {file} ({reason}); check it') from error
    if not isinstance(entries, dict) or 'body' not in entries:
        raise ConfigurationError(f'{file} does not describe a contact; it needs at least an entry like: body: ring')
    defaults = {each.name: each.default for each in fields(Contact)}
    for name, value in entries.items():
        if name not in defaults:
            raise ConfigurationError(f'{file}: a contact has no {name!r}; it has: {", ".join(defaults)}')
        if name != 'body' and not _fits(value, defaults[name]):
            like = list(Contact.tilt_deg) if name == 'tilt_deg' else defaults[name]
            raise ConfigurationError(f'{file}: {name!r} must be like {like}, got {value!r}')
    tilt_deg = tuple(map(float, entries.get('tilt_deg', (0.0, 0.0))))
    try:
        return Contact(**{**entries, 'tilt_deg': tilt_deg, 'body': _beside(file.parent, entries['body'])})
    except ConfigurationError as error:
        raise ConfigurationError(f'{file}: {error}') from error


def _beside(folder: Path, body: object) -> object:
    """Find the files of bodies in the folder of the description."""
    if isinstance(body, list):
        return [
            {**each, 'body': _beside(folder, each.get('body'))} if isinstance(each, dict) else each for each in body
        ]
    if not isinstance(body, str):
        return body
    return str(folder / body) if is_mesh(body) or body.endswith(HEIGHTS) else body


def _fits(value: object, like: object) -> bool:
    if isinstance(like, tuple):
        return isinstance(value, list) and len(value) == len(like) and all(_fits(each, 0.0) for each in value)
    return is_number(value)
