"""A simulated gel whose sides are free, or held by a frame."""

import dataclasses

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import solve
from tactile_nodes.simulation.optics import Optics, Press

GEL = Gel(size_mm=10.0, soft_mm=4.5, skin_mm=0.5, marker_count=400, mechanics='linear')


@pytest.fixture(scope='module')
def optics() -> dict[str, Optics]:
    """By the kind of sides."""
    table = solve(GEL)
    return {sides: Optics(dataclasses.replace(GEL, sides=sides), table) for sides in ('ignored', 'free', 'held')}


def test_a_press_pushes_a_free_side_out_and_a_frame_holds_it(optics: dict[str, Optics]):
    """A tip 2 mm from the side, and the markers between it and the side."""
    x, y, _ = optics['free'].markers_mm.T
    between = (x > 3.5) & (np.abs(y) < 2)
    outwards = {
        name: float(each.displacement_mm((Press(3.0, 0.0, 0.8),))[between, 0].mean()) for name, each in optics.items()
    }
    assert outwards['free'] > 1.2 * outwards['ignored']
    assert outwards['held'] < 0.5 * outwards['ignored']


def test_what_sides_add_grows_with_the_force(optics: dict[str, Optics]):
    def added(depth_mm: float) -> np.ndarray:
        press = (Press(3.0, 0.0, depth_mm),)
        return optics['free'].displacement_mm(press) - optics['ignored'].displacement_mm(press)

    table = solve(GEL)
    forces = [table.force_at(depth) for depth in (0.4, 0.8)]
    assert added(0.8) == pytest.approx(forces[1] / forces[0] * added(0.4), abs=1e-5)


def test_a_dragged_tip_near_a_free_side_pulls_it_along(optics: dict[str, Optics]):
    pressed, dragged = (
        optics['free'].displacement_mm((press,)) - optics['ignored'].displacement_mm((press,))
        for press in (Press(3.0, 0.0, 0.8), Press(3.0, 0.0, 0.8, shift_mm=(0.2, 0.0)))
    )
    assert (dragged - pressed)[:, 0].sum() > 0


def test_the_name_of_a_gel_changes_with_its_sides_only_if_they_count():
    assert dataclasses.replace(GEL, sides='ignored').gel_id == GEL.gel_id
    assert dataclasses.replace(GEL, sides='free').gel_id != GEL.gel_id
    assert 'sides' not in GEL.card


def test_a_round_gel_has_no_sides_that_can_be_simulated():
    with pytest.raises(ConfigurationError, match='flat rectangular'):
        Gel(sides='free', outline='ellipse')
    with pytest.raises(ConfigurationError, match='40 times as wide as thick'):
        Gel(sides='free', size_mm=300.0)
