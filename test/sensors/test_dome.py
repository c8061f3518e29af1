"""Shallow domes: heights and axes by hand, and what is none."""

from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Dome, load_sensor
from tactile_nodes.sensors.writing import text_of, values_of

ROUND = 'width_mm: 16.0, height_mm: 16.0, outline_mm: ellipse, layers_mm: [4.0], moduli_mpa: [0.1]'
GEL = f'{ROUND}, poisson_ratios: [0.49], markers_mm: [0.5, 1.5], dome_radius_mm: 25.0'


def test_the_surface_of_a_dome_is_a_part_of_a_sphere() -> None:
    """7 mm from the middle of a radius of 25: 24 mm above the centre, 1 mm lower than in the middle."""
    assert Dome(25.0).height_mm(np.array([[0.0, 0.0], [7.0, 0.0], [0.0, -7.0]])).tolist() == [0.0, -1.0, -1.0]


def test_the_axes_of_a_dome_lean_outwards() -> None:
    """There it falls by 7 in 24: out of the gel is (7, 0, 24) / 25, along it to the right (24, 0, -7) / 25."""
    along, aside, out = Dome(25.0).axes(np.array([7.0, 0.0])).T
    assert out == pytest.approx([0.28, 0.0, 0.96])
    assert along == pytest.approx([0.96, 0.0, -0.28])
    assert aside == pytest.approx([0.0, 1.0, 0.0])
    assert Dome(0.0).axes(np.array([7.0, 0.0])) == pytest.approx(np.eye(3))


def test_rays_meet_markers_below_the_dome(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(f'gel: {{{GEL}}}\n')
    view = View(load_sensor(tmp_path / 'mine.yaml'))
    place = np.array([[5.0, -4.0], [-2.0, 6.0]])
    seen = view.below_seen_at(place, 0.7)
    flat = view.seen_at(np.column_stack([place, np.full(2, -0.7)]))
    assert (np.hypot(*(seen - 219.5).T) > np.hypot(*(flat - 219.5).T)).all()  # nearer to the lens


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (('25.0', '20.0'), 'a shallow dome has a radius of 22.9 mm or more'),
        (('[0.5, 1.5]', '[0.5, 2.7]'), '1.31 mm lower at its rim'),
        (('25.0', '-1.0'), 'at least 0.0'),
    ],
)
def test_what_is_no_shallow_dome_is_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    (tmp_path / 'mine.yaml').write_text(f'gel: {{{GEL.replace(*change)}}}\n')
    with pytest.raises(ConfigurationError, match=said):
        load_sensor(tmp_path / 'mine.yaml')


def test_a_dome_is_read_as_it_was_written_and_the_card_of_a_flat_gel_says_nothing_of_it(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(f'gel: {{{GEL}}}\n')
    sensor = load_sensor(tmp_path / 'mine.yaml')
    (tmp_path / 'again.yaml').write_text(text_of(sensor, {}))
    assert load_sensor(tmp_path / 'again.yaml') == sensor
    assert 'gel.dome_radius_mm' not in values_of(load_sensor('simulated'))
