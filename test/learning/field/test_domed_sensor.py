"""A sensor with a domed gel: from its description to the force, without any press.

The simulator and the response know the dome by different means: one leans what a flat gel does, as thick as in the
middle, the other solves thinner layers towards the rim (`test/sensing/elasticity/test_domed_regions.py` has both beside
finite elements).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from coarse_table import linear_table
from described_chain import DescribedChain, model_of, sensor_of

from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import BinSettings, GelDescription, ImageSettings
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Optics

DOMED = sensor_of(
    'domed', ImageSettings(640, 480, 480, 480),
    GelDescription(22.0, 22.0, (4.5,), (0.1,), (0.49,), (0.5, 2.5), 0.0, 'ellipse', 40.0), 8000, BinSettings(7, 7),
)  # fmt: skip
"""A disc of 22 mm whose rim is 1.54 mm lower than its middle, and leans by 16 degrees there."""


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return model_of(DOMED, tmp_path_factory.mktemp('described'))


def test_presses_on_a_dome_are_reported_where_they_are_and_how_hard(made: LoadedModel) -> None:
    places_mm = [(0.0, 0.0), (4.0, -3.0), (-5.5, 5.0)]
    DescribedChain(DOMED, made).require_read(places_mm, depth_mm=0.8, share=0.25, off_mm=0.6)


def test_markers_lie_lower_towards_the_rim_and_the_camera_sees_them_where_regions_expect_them() -> None:
    gel = gel_of(DOMED)
    optics = Optics(gel, linear_table(dataclasses.replace(gel, mechanics='linear')))
    flat = gel_of(dataclasses.replace(DOMED, gel=dataclasses.replace(DOMED.gel, dome_radius_mm=0.0)))
    before = Optics(flat, linear_table(dataclasses.replace(flat, mechanics='linear'))).markers_mm
    away = np.hypot(*before[:, :2].T)
    assert optics.markers_mm[:, 2] - before[:, 2] == pytest.approx(np.sqrt(40.0**2 - away**2) - 40.0, abs=1e-5)
    places, depth_mm = optics.markers_mm[:50, :2].astype(float), -before[:50, 2]
    view = View(DOMED)
    expected = [view.below_seen_at(place[None], float(depth))[0] for place, depth in zip(places, depth_mm, strict=True)]
    assert optics.project(())[:50] - [80, 0] == pytest.approx(np.array(expected), abs=0.01)


def test_a_pressure_on_a_patch_is_the_response_to_that_patch() -> None:
    """What presses fit by, and what forces are read by."""
    regions = Regions(DOMED, 5, 5)
    known, patches = np.flatnonzero(regions.usable), regions.patches
    chosen = 5 * patches.shape[1] + 9
    one = regions.terms_of_patches(known)[..., chosen]
    spectrum = regions.layer.rectangle(*patches.size_mm)
    other = regions.terms_of_pressure(patches.centres_mm[chosen][None], spectrum, known)[0]
    assert other == pytest.approx(one, abs=2e-4 * float(np.abs(one).max()))
