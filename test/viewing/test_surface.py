"""What acts on the gel: net shear and torsion of a force, and the field as those who draw it need it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from seen import CELLS, PLACE_MM, RADIUS_MM, SHEAR_SIGMA_N, TORSION_SIGMA_N_MM, force, ring

from tactile_nodes import conversions
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.viewing.net import net_of
from tactile_nodes.viewing.surface import Surface, over_half, surface_of


def test_net_shear_and_torsion_are_those_that_act_about_the_centre_of_pressure() -> None:
    found = net_of(ring(0)[0])
    assert found.explanation == 'field'
    assert (found.shear_n, found.direction_rad) == (pytest.approx(0.6, abs=1e-6), pytest.approx(0.0, abs=1e-6))
    assert found.shear_sigma_n == pytest.approx(SHEAR_SIGMA_N)
    assert found.torsion_n_mm == pytest.approx(4.0, abs=1e-5)
    # T F / F_z: beside T_z itself, F_x with T_x / F_z = 3 mm, F_y with T_y / F_z = 4 mm in size, and no F_z, as
    # (T_z - torsion) / F_z = (-3 mm * -0.6 N) / 2 N = 0.9 mm
    sigma = math.sqrt(TORSION_SIGMA_N_MM**2 + (3 * SHEAR_SIGMA_N) ** 2 + (4 * SHEAR_SIGMA_N) ** 2 + (0.9 * 0.01) ** 2)
    assert found.torsion_sigma_n_mm == pytest.approx(sigma, rel=1e-6)


def test_a_model_that_looks_for_normal_forces_alone_tells_no_shear() -> None:
    fields = conversions.force_fields(np.ones((2, 2), np.float32), BinGrid(2, 2, 4.0, 4.0))
    found = net_of(types.ForceDistribution(**fields))
    assert not found.is_known
    assert found.explanation == ''


def test_where_nothing_touches_there_is_no_torsion() -> None:
    found = net_of(force(10, explanation=types.ForceDistribution.EXPLANATION_NOTHING))
    assert (found.explanation, found.shear_n) == ('nothing', 0.0)
    assert math.isnan(found.torsion_n_mm)


def test_an_invalid_force_tells_no_shear() -> None:
    assert not net_of(ring(0, types.ForceDistribution.STATUS_INVALID)[0]).is_known


def cells(field: types.ForceField) -> Surface:
    found = surface_of(field)
    assert found is not None
    return found


def test_cells_are_in_kilopascals_and_millimetres() -> None:
    field = ring(0)[1]
    found = cells(field)
    area_mm2 = found.cell_mm[0] * found.cell_mm[1]
    assert found.pressure_kpa.sum() * 1e-3 * area_mm2 == pytest.approx(2.0, rel=1e-5)
    assert found.shear_kpa.sum(axis=(0, 1)) * 1e-3 * area_mm2 == pytest.approx([0.6, 0.0], abs=1e-5)
    x, y = found.centres_mm
    assert (x[0], y[-1], len(x)) == (pytest.approx(-17.5), pytest.approx(17.5), CELLS)


def test_the_outline_of_a_ring_is_a_line_inside_and_one_outside() -> None:
    force, field = ring(0)
    shares = over_half(cells(field), force.contacts)
    middle = shares[round(PLACE_MM[1] + 17.5)]  # the row of cells through the centre
    assert np.count_nonzero(np.diff(middle > 1)) == 4
    inside = np.argwhere(shares > 1) + 0.5 - CELLS / 2
    away = np.hypot(inside[:, 1] - PLACE_MM[0], inside[:, 0] - PLACE_MM[1])
    # exp(-(d / 0.8)²) is above a half as far as 0.67 mm from the radius; the cells' own size is 1 mm
    assert np.abs(away - RADIUS_MM).max() < 0.67 + 0.1


def test_a_weak_contact_beside_a_strong_one_has_an_outline_of_its_own() -> None:
    pressure = np.zeros((10, 10), np.float32)
    pressure[2, 2], pressure[2, 3], pressure[7, 7], pressure[7, 8] = 100e3, 40e3, 10e3, 6e3
    field = types.ForceField(rows=10, cols=10, cell_width=1e-3, cell_height=1e-3, pressure=pressure.reshape(-1))
    contacts = [types.Contact(position=types.Point(x=at, y=at)) for at in (2.5e-3, 7.5e-3)]
    shares = over_half(cells(field), contacts)
    assert [shares[2, 2], shares[2, 3], shares[7, 7], shares[7, 8]] == pytest.approx([2.0, 0.8, 2.0, 1.2])


def test_the_end_of_a_long_contact_belongs_to_it_though_another_centre_is_nearer() -> None:
    pressure = np.zeros((1, 20), np.float32)
    pressure[0, :15], pressure[0, 18] = 100.0, 10.0
    field = types.ForceField(rows=1, cols=20, cell_width=1e-3, cell_height=1e-3, pressure=pressure.reshape(-1))
    edge = types.Contact(position=types.Point(x=7.5e-3, y=0.5e-3), length=15e-3, width=1e-3)
    tip = types.Contact(position=types.Point(x=18.5e-3, y=0.5e-3), length=1e-3, width=1e-3)
    shares = over_half(cells(field), [edge, tip])
    assert shares[0, [14, 18]] == pytest.approx([2.0, 2.0])


def test_without_a_contact_there_is_no_outline() -> None:
    assert not over_half(cells(ring(0)[1]), []).any()


@pytest.mark.parametrize(
    'change', [{'rows': 35}, {'shear_x': np.zeros(3, np.float32)}, {'pressure': np.zeros(7, np.float32)}]
)
def test_a_field_that_does_not_fill_its_grid_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(MessageError, match='a force field has'):
        surface_of(dataclasses.replace(ring(0)[1], **change))


@pytest.mark.parametrize('change', [{'pressure': np.zeros(0, np.float32)}, {'status': 2}])
def test_a_field_that_knows_nothing_is_none(change: dict[str, object]) -> None:
    assert surface_of(dataclasses.replace(ring(0)[1], **change)) is None
