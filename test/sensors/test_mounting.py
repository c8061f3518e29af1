"""Where a sensor is mounted: transforms by hand."""

import numpy as np
import pytest

from tactile_nodes.sensors import Mounting


def test_a_point_of_the_surface_is_where_the_mounting_takes_it() -> None:
    # Rolled by 90 degrees, y becomes z and z becomes -y; yawed by 90 after that, x becomes y and y becomes -x. So
    # (1, 2, 3) mm goes to (1, -3, 2), then to (3, 1, 2), and with the position to (13, -19, 32) mm.
    mounted = Mounting(position_mm=(10.0, -20.0, 30.0), rpy_deg=(90.0, 0.0, 90.0))
    found = mounted.parent_from_surface @ (0.001, 0.002, 0.003, 1.0)
    assert found == pytest.approx((0.013, -0.019, 0.032, 1.0))


def test_a_pitch_of_a_right_angle_turns_the_outward_axis_forwards() -> None:
    mounted = Mounting(position_mm=(0.0, 0.0, 12.0), rpy_deg=(0.0, 90.0, 0.0))
    assert mounted.parent_from_surface @ (0.0, 0.0, 0.001, 1.0) == pytest.approx((0.001, 0.0, 0.012, 1.0))


def test_the_transform_is_made_once_and_nobody_can_change_it() -> None:
    mounted = Mounting(position_mm=(0.0, 0.0, 12.0))
    assert mounted.parent_from_surface is mounted.parent_from_surface
    with pytest.raises(ValueError, match='read-only'):
        mounted.parent_from_surface[0, 3] = 1.0


def test_every_mounting_is_a_rigid_motion() -> None:
    turned = Mounting(rpy_deg=(20.0, -35.0, 110.0)).parent_from_surface[:3, :3]
    assert turned @ turned.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turned) == pytest.approx(1.0)
