"""A sensor with a round gel: from its description to the force, without any press."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from described_chain import DescribedChain, model_of, sensor_of

from tactile_nodes.drivers.camera.contract import SceneSettings
from tactile_nodes.drivers.camera.simulated import build_scene
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.inspection.judging import outline_px
from tactile_nodes.sensors import BinSettings, GelDescription, ImageSettings, load_sensor
from tactile_nodes.sensors.writing import text_of
from tactile_nodes.simulation.described import gel_of
from tactile_nodes.simulation.optics import Press, place_markers

ROUND = sensor_of(
    'round', ImageSettings(640, 480, 480, 480),
    GelDescription(22.0, 22.0, (4.0,), (0.1,), (0.49,), (0.5, 2.5), 0.0, 'ellipse'), 8000, BinSettings(7, 7),
)  # fmt: skip
"""A disc of 22 mm, all of it in a picture of 480x480 px, 20 px a millimetre."""


OCTAGON = '-6,-16 6,-16 16,-6 16,6 6,16 -6,16 -16,6 -16,-6'


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return model_of(ROUND, tmp_path_factory.mktemp('described'))


def test_nothing_is_seen_or_found_beside_the_disc(made: LoadedModel) -> None:
    """Of 14x14 patches of 1.57 mm 10 in each corner have their middle more than 11 mm from the centre."""
    readout = made.model.readout
    assert isinstance(readout, FieldReadout)
    beside = np.hypot(*readout.solver.patches.centres_mm.T) > 11.0
    moved = readout.response.reshape(len(readout.response), 3, -1).any(axis=0)
    assert beside.sum() == 4 * 10
    assert not moved[:, beside].any()
    assert moved[:, ~beside].all()
    trusted = readout.scaling.trusted
    assert not trusted[0, 0]
    assert trusted[trusted.shape[0] // 2, trusted.shape[1] // 2]


@pytest.mark.parametrize('compiled', [False, True])
def test_a_press_on_a_round_gel_is_reported_where_it_is_and_how_hard(made: LoadedModel, compiled: bool) -> None:
    """Presses in the middle, half way out, and 1.8 mm from the rim."""
    chain = DescribedChain(ROUND, made, compiled=compiled)
    assert isinstance(made.model.readout, FieldReadout)
    for x_mm, y_mm in ((0.0, 0.0), (2.5, -2.5), (-6.5, 6.5)):
        read, true_n = chain.read(Press(x_mm, y_mm, 0.8)), chain.table.force_at(0.8)
        assert read.total_n == pytest.approx(true_n, rel=0.2)
        assert abs(read.total_n - true_n) < 3 * read.total_sigma_n
        assert np.hypot(read.contacts[0].x_mm - x_mm, read.contacts[0].y_mm - y_mm) < 0.5
        assert np.isfinite(read.normal_force_n).all()
        assert read.normal_force_n[0, 0] == read.normal_force_n[-1, -1] == 0
    assert chain.read().total_n < 0.005


def test_the_simulated_gel_has_markers_within_its_rim_alone() -> None:
    places, _ = place_markers(gel_of(ROUND))
    assert np.hypot(*places[:, :2].T).max() <= 11.0
    assert len(places) == pytest.approx(8000 * np.pi / 4, rel=0.03)


def test_presses_of_the_live_scene_stay_within_the_rim(tmp_path: Path) -> None:
    (tmp_path / 'round.yaml').write_text(text_of(ROUND, {}))
    scene = build_scene(SceneSettings(contact='tip'), sensor=str(tmp_path / 'round.yaml'))
    places = [scene.schedule.press_at(round((number + 0.5) * 2e9)) for number in range(50)]
    assert max(np.hypot(each.x_mm, each.y_mm) for each in places) < 11.0


def test_the_figure_of_a_check_draws_the_rim_where_the_picture_has_it() -> None:
    """11 mm from the axis and 19.5 mm before the lens, where markers begin: 400 * 11 / 19.5 = 225.6 px from the middle,
    as far as a polygon of 180 corners is a circle."""
    away = np.hypot(*(outline_px(usual_regions(ROUND)) - 239.5).T)
    assert away.max() == pytest.approx(225.64, abs=0.01)
    assert away.min() == pytest.approx(225.64, abs=0.05)


def test_a_round_gel_under_the_papers_camera_is_seen_within_its_rim_alone(tmp_path: Path) -> None:
    """Such a model takes the regions of the source as known: not those in the corners, whose rays miss an octagon."""
    paper = load_sensor('simulated')
    disc = dataclasses.replace(paper.gel, outline_mm=OCTAGON)
    readout = model_of(dataclasses.replace(paper, gel=disc), tmp_path).model.readout
    assert isinstance(readout, FieldReadout)
    trusted = readout.scaling.trusted > 0
    assert not trusted[3, 3]
    assert not trusted[-4, 4]
    assert trusted[10, 3]
    assert trusted[3, 10]
