from __future__ import annotations

from dataclasses import replace

import pytest

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensors import load_sensor


@pytest.mark.parametrize(('width', 'height', 'side'), [(431, 440, 431), (446, 440, 446), (440, 433, 433)])
def test_a_crop_that_no_usual_number_of_regions_divides_is_refused(width: int, height: int, side: int):
    """431 and 433 are primes and 446 = 2 x 223: one or two regions would be left of some twenty, without any force."""
    sensor = load_sensor('speckle_membrane')
    odd = replace(sensor, image=replace(sensor.image, crop=width, crop_height=height))
    with pytest.raises(ConfigurationError, match=f'a side of {side} px cannot be .* multiples of 40, such as 4[04]0'):
        usual_regions(odd)


def test_a_crop_whose_regions_are_nearly_the_usual_ones_is_accepted():
    """442 = 13 x 34, where 25 and 32 regions are usual; more than 26 would be narrower than 14 px."""
    sensor = load_sensor('speckle_membrane')
    regions = usual_regions(replace(sensor, image=replace(sensor.image, crop=442, crop_height=442)))
    assert (regions.rows, regions.cols) == (26, 26)


@pytest.mark.parametrize(('name', 'rows', 'cols'), [('simulated', 20, 20), ('speckle_membrane', 24, 32)])
def test_markers_near_the_surface_are_seen_by_regions_half_as_wide_as_patches(name: str, rows: int, cols: int):
    """18 x 18 patches of the paper's sensor have 20 x 20 regions, 14 x 18 of a membrane 24 x 32."""
    regions = usual_regions(load_sensor(name))
    assert (regions.rows, regions.cols) == (rows, cols)
