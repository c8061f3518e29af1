"""The simulated gel of a described sensor."""

import dataclasses

import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensors import GelDescription, PatternDescription, Sensor, load_sensor
from tactile_nodes.simulation.camera import pupil
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, place_markers

MEMBRANE = load_sensor('speckle_membrane')


def test_the_sensor_that_ships_is_the_gel_that_is_simulated_by_default():
    assert gel_of(load_sensor('simulated')) == Gel()


def test_markers_lie_where_the_description_has_them():
    """Under 25x19 mm, from 0.2 to 0.5 mm deep."""
    places, _ = place_markers(gel_of(MEMBRANE))
    assert len(places) == 9000
    assert np.abs(places[:, :2]).max(axis=0) == pytest.approx([12.5, 9.5], abs=0.02)
    assert places[:, 2].min() == pytest.approx(-0.5, abs=0.01)
    assert places[:, 2].max() == pytest.approx(-0.2, abs=0.01)


def test_dots_are_printed_in_rows_and_columns_through_the_one_that_is_described():
    """2.5 mm apart on 25x19 mm: 10 in a row, 7 in a column."""
    pattern = PatternDescription('dots', 1, (1.0, 1.0), 2.5, dark=True, dot_mm=(-1.25, 2.5))
    sensor = dataclasses.replace(MEMBRANE, pattern=pattern)
    places, diameter_mm = place_markers(gel_of(sensor))
    per_dot = len(places) // 70
    centres = places.reshape(7, 10, per_dot, 3).mean(axis=2)
    assert centres[0, :, 0] == pytest.approx(2.5 * (np.arange(10) - 4.5), abs=1e-4)
    assert centres[:, 0, 1] == pytest.approx(2.5 * (np.arange(7) - 3), abs=1e-4)
    assert per_dot * diameter_mm[0] ** 2 == pytest.approx(1.0)  # the area of a dot
    assert np.ptp(places[:, 2]) == 0


def test_dark_dots_are_darker_than_the_gel_around_them():
    sensor = dataclasses.replace(MEMBRANE, pattern=PatternDescription('dots', 1, (1.0, 1.0), 2.5, dark=True))
    gel = dataclasses.replace(gel_of(sensor), mechanics='linear')
    optics = Optics(gel, linear_table(gel))
    light = optics.radiance(())
    u, v = np.round(optics.camera.project(np.array([[2.5, 0.0, -0.35]]) - pupil(gel))[0]).astype(int)
    assert light[v, u] < 0.5 * light[v, u + 32]  # 1.25 mm further, between two dots


def test_where_dark_dots_lie_over_each_other_it_is_black():
    """Three of -100 grey levels on 140 would be less than no light."""
    gel = dataclasses.replace(gel_of(load_sensor('printed_dots')), mechanics='linear', pitch_mm=0.5)
    optics = Optics(gel, linear_table(gel))
    assert optics.radiance(()).min() == 0


def test_layers_that_differ_cannot_be_simulated():
    sensor = Sensor('two', gel=GelDescription(layers_mm=(1.5, 4.5), moduli_mpa=(0.2, 0.1)))
    with pytest.raises(ConfigurationError, match='has different layers'):
        gel_of(sensor)
