from __future__ import annotations

import math

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.simulation.gel import Gel


def test_a_gel_takes_what_is_given_and_keeps_the_rest():
    gel = Gel.from_mapping({'seed': 7, 'marker_diameter_mm': [0.2, 0.3], 'soft_mm': 4})
    assert (gel.seed, gel.marker_diameter_mm, gel.soft_mm, gel.skin_mm) == (7, (0.2, 0.3), 4, 1.5)


def test_the_camera_looks_up_from_23_millimetres_below_the_surface():
    assert Gel().pupil_z_mm == -23.0


def test_any_other_property_makes_another_id():
    assert Gel().gel_id == Gel(seed=1).gel_id
    assert Gel().gel_id != Gel(blur_px=0.6).gel_id


def test_properties_that_came_later_leave_the_id_of_older_gels_alone():
    assert Gel().gel_id == Gel(exposure_s=0.0).gel_id
    assert Gel().gel_id != Gel(exposure_s=0.01).gel_id
    assert Gel(mechanics='finite_strain').gel_id != Gel(mechanics='finite_strain', contact='smooth').gel_id


def test_cards_of_a_flat_rectangle_name_no_rim_and_no_dome() -> None:
    assert not {'outline', 'dome_radius_mm'} & Gel().card.keys()
    assert Gel(outline='ellipse').card['outline'] == 'ellipse'
    assert Gel(outline='ellipse').gel_id != Gel().gel_id != Gel(dome_radius_mm=70.0).gel_id


@pytest.mark.parametrize(
    ('properties', 'said'),
    [
        ({'outline': 'round'}, 'must be empty .a rectangle., ellipse, or three corners'),
        ({'dome_radius_mm': 20.0}, 'a shallow dome has a radius of 64.6 mm or more'),
        ({'dome_radius_mm': -20.0}, 'a shallow dome has a radius of 64.6 mm or more'),
    ],
)
def test_a_gel_of_no_shape_is_refused(properties: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        Gel.from_mapping(properties)


@pytest.mark.parametrize(
    ('name', 'value'),
    [('sead', 1), ('seed', 1.5), ('seed', True), ('soft_mm', 'thick'), ('mechanics', 'plastic'), ('contact', 'wet'),
     ('mechanics', 3), ('size_mm', -1.0), ('marker_count', 0), ('shear_modulus_mpa', -0.1), ('poisson_ratio', 0.6),
     ('vignetting', 1.0), ('settling_s', 0.0), ('image_width', 0), ('marker_diameter_mm', ['a', 'b']),
     ('blur_px', math.nan), ('shear_modulus_mpa', 111.0)],
)  # fmt: skip
def test_property_that_no_gel_has_is_refused_by_its_name(name: str, value: object) -> None:
    with pytest.raises(ConfigurationError, match=name):
        Gel.from_mapping({name: value})


def test_gel_without_thickness_is_refused() -> None:
    with pytest.raises(ConfigurationError, match='layer_mm'):
        Gel(soft_mm=0.0, skin_mm=0.0)
