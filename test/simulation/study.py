"""The numbers of docs/simulation.md: PYTHONPATH=.:test python test/simulation/study.py NAME, a function at the end.

Each takes a minute or two on one core, `touches` five. These are measurements, not tests; the tests check the same in
small.
"""

from __future__ import annotations

import dataclasses
import os
import sys

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import time

import numpy as np
from coarse_table import linear_table

from benchmarks.collection import CNC, SAFE_Z_MM, named
from benchmarks.devices.rehearsal import Rehearsal
from tactile_nodes.collection.press.rest import go_to_gel
from tactile_nodes.collection.press.surface import Corner, corners, feel_corner, surface_through
from tactile_nodes.contact_tables.gel_tables import contact_table, load_gel, solution_of
from tactile_nodes.contact_tables.touch_tables import CELL_MM, CELLS
from tactile_nodes.drivers.camera.contract import SceneSettings
from tactile_nodes.drivers.camera.simulated import build_scene
from tactile_nodes.emulators.world import World, WorldSettings
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.contact import Where
from tactile_nodes.simulation.elements import Mesh, graded
from tactile_nodes.simulation.finite_strain import Indentation
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.indenter import PAPER_TIP, indenter_name
from tactile_nodes.simulation.optics import Optics, Press
from tactile_nodes.simulation.scene import PressSchedule, Scene
from tactile_nodes.simulation.solution import Problem, solve_problem
from tactile_nodes.simulation.touch.bricks import Bricks, Layer
from tactile_nodes.simulation.touch.families import make_body
from tactile_nodes.simulation.touch.track import Way, solve_track

DEPTHS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5)
MARKERS_R, MARKERS_Z = np.linspace(0, 6, 31), np.linspace(-6, -1.5, 19)
LINEAR = Gel(mechanics='linear', shear_modulus_mpa=0.155)
FINITE = Gel(mechanics='finite_strain')


def mesh() -> None:
    """Force over G and displacements of markers, as elements get smaller."""
    found = {}
    for finest, growth in ((0.16, 1.2), (0.12, 1.16), (0.08, 1.12), (0.055, 1.09)):
        start = time.process_time()
        solution = solve_problem(dataclasses.replace(Problem(), finest_mm=finest, growth=growth, rungs=10))
        rungs = [np.abs(solution.depth_mm - depth).argmin() for depth in DEPTHS if depth != 1.5]
        found[finest] = solution.at(MARKERS_R, MARKERS_Z)[rungs]
        print(f'{finest:.3f} mm, {solution.moved_mm[0].size} unknowns, {time.process_time() - start:.0f} s:', end=' ')
        print('F/G =', ' '.join(f'{force:.3f}' for force in solution.force_mm2[rungs]), 'mm²')
    for finest, moved in found.items():
        print(
            f'{finest:.3f} mm: markers differ from the finest by',
            np.abs(moved - moved_finest(found)).max((1, 2, 3)) * 1e3,
            'µm',
        )


def moved_finest(found: dict[float, np.ndarray]) -> np.ndarray:
    return found[min(found)]


def linear() -> None:
    """The linear table against the finite-strain one: force at the same G, and motion of markers."""
    tables = linear_table(LINEAR), contact_table(dataclasses.replace(FINITE, shear_modulus_mpa=0.155))
    optics = [Optics(LINEAR, table) for table in tables]
    rest = optics[0].project(())
    for depth in (0.125, *DEPTHS):
        force = [table.force_at(depth) for table in tables]
        moved = [each.project((Press(0.0, 0.0, depth),)) - rest for each in optics]
        size, wrong = (np.hypot(*each.T) for each in (moved[1], moved[0] - moved[1]))
        largest = ' '.join(f'{np.hypot(*each.T).max():.3f}' for each in moved)
        share = np.sqrt((wrong**2).sum() / (size**2).sum())
        print(
            f'{depth:.3f} mm: F {force[0]:.4f} {force[1]:.4f} N ({force[0] / force[1] - 1:+.1%}), largest motion '
            f'{largest} px, differ by {wrong.max():.3f} px at most, {share:.1%} of the root mean square'
        )


def friction() -> None:
    """Force over G with Coulomb friction between none and sticking, and how markers differ from sticking."""
    stuck = solution_of(Problem())
    for coefficient in (0.0, 0.5):
        press = Indentation(Problem().mesh(), PAPER_TIP, friction=coefficient)
        for depth in (0.25, 0.5, 1.0, 1.25, 1.5, 2.0):
            try:
                press.advance(Where(0.0, depth), 0.0125)
            except ConfigurationError as error:
                print(f'friction {coefficient}: {error}')
                break
            own = dataclasses.replace(stuck, moved_mm=np.repeat(_nodes(press)[None], len(stuck.depth_mm), 0))
            moved = own.at(MARKERS_R, MARKERS_Z)[0]
            reference = _at_depth(stuck, depth)
            own_force, force = press.touch.pushes[1], np.interp(depth, stuck.depth_mm, stuck.force_mm2)
            wrong, size = (np.abs(each).max() * 1e3 for each in (moved - reference, reference))
            print(f'friction {coefficient}, {depth:.2f} mm: F/G {own_force:.3f} (sticking {force:.3f},', end=' ')
            print(f'{own_force / force - 1:+.1%}), markers differ by {wrong:.1f} µm of {size:.0f}', flush=True)


def _nodes(press: Indentation) -> np.ndarray:
    return press.state.u.reshape(*press.body.mesh.nodes, 2)


def _at_depth(solution, depth: float) -> np.ndarray:
    """Displacements of markers: these depths lie on the ladder."""
    return solution.at(MARKERS_R, MARKERS_Z)[np.abs(solution.depth_mm - depth).argmin()]


def pair() -> None:
    """Two tips against the sum of two single ones: in plane strain, which exaggerates, and to first order in 3-D."""
    z = Problem().mesh().z_mm
    single = Indentation(Mesh(_lines(36.0, 36.0), z, plane=True), PAPER_TIP, symmetric=False)
    pairs = {
        half: Indentation(Mesh(_lines(half, 36.0), z, plane=True), PAPER_TIP, start=Where(half, 0.0))
        for half in (1.5, 3.0, 5.0)
    }
    for depth in (0.5, 1.0, 2.0):
        single.advance(Where(0.0, depth))
        for half, press in pairs.items():
            press.advance(Where(half, depth))
            points = np.linspace(0, 8, 33)
            one, other = (_plane(single, points - side * half) for side in (1, -1))
            both = _plane(press, points)
            wrong, size = (np.abs(each).max() * 1e3 for each in (one + other - both, both))
            more = press.touch.pushes[1] / single.touch.pushes[1] - 1
            print(f'plane strain, {2 * half:.0f} mm apart, {depth} mm deep: force {more:+.1%},', end=' ')
            print(f'markers {wrong:.0f} µm of {size:.0f}', flush=True)
    table = contact_table(FINITE)
    for apart in (3.0, 6.0, 10.0):
        for depth in (0.5, 1.0, 2.0):
            sunk = np.interp(apart, table.radius_mm, table.displacement_at(depth)[1][:, -1])
            print(f'3-D, {apart:.0f} mm apart, {depth} mm deep: the neighbour moves', end=' ')
            print(f'the surface by {sunk * 1e3:+.0f} µm ({sunk / depth:+.1%})')


def _lines(left: float, right: float) -> np.ndarray:
    """Lines from `left` of the tip to `right` of it, fine at the tip, counted from the left end or from the tip."""
    inner = graded(left, 0.08, 1.12, min(1.0, left / 2))
    outer = graded(right, 0.08, 1.12, 1.0)
    start = 0.0 if left == right else left
    return start + np.concatenate([-inner[:0:-1], outer])


def _plane(press: Indentation, points: np.ndarray) -> np.ndarray:
    mesh, u = press.body.mesh, _nodes(press)
    solution = dataclasses.replace(solution_of(Problem()), across_mm=mesh.across_mm, z_mm=mesh.z_mm, moved_mm=u[None])
    return solution.at(np.clip(points, mesh.across_mm[0], mesh.across_mm[-1]), MARKERS_Z)[0]


def shear() -> None:
    """A tip dragged sideways at several depths, in plane strain: what the depth changes, and the drag."""
    points = np.linspace(-6, 6, 49)
    reference = None
    for depth in (0.25, 0.5, 1.0, 2.0):
        press = Indentation(Mesh(_lines(36.0, 36.0), Problem().mesh().z_mm, plane=True), PAPER_TIP, symmetric=False)
        press.advance(Where(0.0, depth))
        before, drag = _plane(press, points), press.touch.pushes[0]
        for shift in (0.05, 0.25, 0.5):
            press.advance(Where(shift, depth))
            field = (_plane(press, points) - before) / shift
            reference = field if reference is None else reference
            wrong = np.abs(field - reference).max() / np.abs(reference).max()
            stiffness = abs(press.touch.pushes[0] - drag) / shift
            print(f'{depth} mm deep, dragged {shift} mm: {stiffness:.3f} G a mm,', end=' ')
            print(f'markers differ by {wrong:.0%} of the largest motion at 0.25 mm', flush=True)


def speed() -> None:
    """Frames a second of processor time on one core."""
    import cv2

    cv2.setNumThreads(1)
    optics = Optics(FINITE, contact_table(FINITE))
    jpeg = Optics(dataclasses.replace(FINITE, jpeg_quality=90), contact_table(FINITE))
    settling = Scene(
        dataclasses.replace(FINITE, settling_share=0.15, exposure_s=0.008, jpeg_quality=90),
        PressSchedule(),
        table=contact_table(FINITE),
    )

    ring = build_scene(SceneSettings(contact='ring', start_ns=1))

    def press(i: int) -> tuple[Press, ...]:
        """Another depth each time: what stays as it was is not drawn anew."""
        return (Press(2.0, 1.0, 1.0 + i * 1e-3),)

    for name, render in {
        'rest': lambda i: optics.render((), i),
        'press that stays': lambda i: optics.render(press(0), i),
        'press': lambda i: optics.render(press(i), i),
        'press, blurred': lambda i: optics.expose((press(i), press(i + 10)), i),
        'press, JPEG': lambda i: jpeg.render(press(i), i),
        'press, dragged': lambda i: optics.render((dataclasses.replace(press(i)[0], shift_mm=(0.3, 0.1)),), i),
        'two presses': lambda i: optics.render((*press(i), Press(-5.0, 3.0, 1.5)), i),
        'live scene: a ring': lambda i: ring.render(1 + i * 16_666_667),
        'live scene: settling, blur and JPEG': lambda i: settling.render(i * 16_666_667),
    }.items():
        render(0)
        times = []
        for i in range(1, 241):
            start = time.process_time()
            render(i)
            times.append(time.process_time() - start)
        times.sort()
        middle, late = times[120] * 1e3, times[237] * 1e3
        print(f'{name}: {1 / np.mean(times):.0f} frames/s, median {middle:.1f} ms, 99 % {late:.1f} ms')


def surface() -> None:
    """How much too high a collection finds the surface, at three heights between the steps of its search."""
    for gel, indenter in (('', 'tip'), ('stiff', 'tip'), ('lifelike', 'tip'), ('', 'ball'), ('', 'punch')):
        found = []
        for height in (-30.0, -30.017, -30.033):
            world = World(WorldSettings(gel=gel, indenter=indenter, gel_z_mm=height))
            settings = named(indenter_name(load_gel(gel).tip_radius_mm, indenter))
            rig = Rehearsal(world, settings, CNC)
            rig.cnc.home()
            rig.hands.run(go_to_gel(settings, SAFE_Z_MM))
            felt: list[Corner] = []
            for at in corners(settings):
                felt.append(rig.hands.run(feel_corner(settings, SAFE_Z_MM, at, felt, [])))
            found.append(surface_through(felt, settings).z_mm - height)
        print(gel or 'paper', indenter, ' '.join(f'{each * 1000:+.1f}' for each in found), 'µm')


def touches() -> None:
    """Contacts of 2 N on the paper's gel, dragged by 0.6 mm: as shipped (0.4 mm), and on a finer grid (0.3 mm)."""
    way = Way(force_mm2=18.0, drag_mm=0.6, press_stages=3, drag_stages=3)
    for name in ('ball', 'ring', 'edge', 'screw'):
        compared = []
        for cells, rows in ((CELLS, 9), (4 * CELLS // 3, 11)):
            bricks = Bricks(Layer(cells, CELLS * CELL_MM / cells, FINITE.layer_mm, rows=rows))
            start = time.process_time()
            track = solve_track(bricks, make_body(name), way)
            took_s = time.process_time() - start
            pressed, dragged = (np.abs(track.moved_mm[i]).max(axis=(2, 3)) for i in (3, -1))
            level = [np.interp(-2.0, track.z_mm, each) for each in (pressed[:, 2], dragged[:, 0])]
            shear = track.force[-1, 0] / 18
            compared.append((track.depth_mm[3], shear, *level))
            print(f'{name} {cells} cells, {rows} rows: {took_s:.0f} s, {track.depth_mm[3]:.3f} mm deep,', end=' ')
            print(f'shear {shear:.3f} of the force, slips {track.slip_share[-1]:.0%};', end=' ')
            print(f'2 mm down: {level[0]:.3f} mm down, {level[1]:.3f} mm aside', flush=True)
        print(name, 'differs by', ' '.join(f'{a / b - 1:+.1%}' for a, b in zip(*compared, strict=True)), flush=True)


if __name__ == '__main__':
    {each.__name__: each for each in (mesh, linear, friction, pair, shear, speed, surface, touches)}[sys.argv[1]]()
