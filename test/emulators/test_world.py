"""The shared world: motion, contact, the digital line."""

from __future__ import annotations

import math

import pytest
from coarse_table import coarse_table
from hypothesis import given
from hypothesis import strategies as st

from tactile_nodes.emulators.motion import Braking, Timeline, Trapezoid, line
from tactile_nodes.emulators.world import STIFF_N_PER_MM, Edge, World, WorldSettings
from tactile_nodes.simulation.gel import Gel

S = 1_000_000_000
ACCELERATION = (100.0, 100.0, 100.0)


def world(**settings: object) -> World:
    return World(WorldSettings(**settings), table=coarse_table())  # type: ignore[arg-type]


def pressed(depth_mm: float, x: float = -60.0, y: float = -60.0, **settings: object) -> World:
    """A world in which the tip rests at a place, below the height of the gel's centre."""
    return world(start_mm=(x, y, -30.0 - depth_mm), **settings)


@pytest.mark.parametrize(
    ('setting', 'values'), [('start_mm', (1.0, 2.0)), ('room_mm', (1.0, 2.0, 3.0, 4.0)), ('room_mm', (9.0, 0.0, 9.0))]
)
def test_settings_that_are_no_place_or_no_room_are_refused(setting: str, values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=f'{setting} must be three numbers'):
        WorldSettings(**{setting: values})


def test_a_trapezoid_takes_the_time_of_the_school_book() -> None:
    """10 mm at 10 mm/s with 100 mm/s²: ramps of 0.1 s and 0.5 mm each, 9 mm between."""
    shape = Trapezoid(10.0, 10.0, 100.0)
    assert shape.duration_s == pytest.approx(1.1)
    assert [shape.distance(t) for t in (0.0, 0.1, 0.55, 1.0, 1.1)] == pytest.approx([0.0, 0.5, 5.0, 9.5, 10.0])


def test_a_short_line_does_not_reach_its_feed() -> None:
    """1 mm with 100 mm/s²: at most sqrt(100) = 10 mm/s, in 0.2 s."""
    shape = Trapezoid(1.0, 50.0, 100.0)
    assert (shape.peak, shape.duration_s) == pytest.approx((10.0, 0.2))


def test_braking_takes_half_the_square_of_the_speed_over_the_deceleration() -> None:
    brake = Braking(10.0, 100.0)
    assert (brake.duration_s, brake.distance(5.0)) == pytest.approx((0.1, 0.5))


@given(st.floats(0.01, 50), st.floats(0.1, 40), st.floats(10, 500), st.floats(0, 1))
def test_speed_is_the_slope_of_distance_and_never_above_the_feed(
    length: float, feed: float, acceleration: float, share: float
) -> None:
    shape = Trapezoid(length, feed, acceleration)
    t, h = share * shape.duration_s, 1e-5 * shape.duration_s
    slope = (shape.distance(t + h) - shape.distance(t - h)) / (2 * h)
    assert slope == pytest.approx(shape.speed(t), abs=acceleration * 2 * h + 1e-6)
    assert shape.speed(t) <= feed * (1 + 1e-9)


def test_the_slowest_axis_limits_a_diagonal() -> None:
    """Along (1, 1, 0)/√2 an acceleration of 50 on x allows 50 √2."""
    segment = line(0, (0.0, 0.0, 0.0), (3.0, 3.0, 0.0), 10.0, (50.0, 500.0, 500.0))
    assert segment.shape.acceleration == pytest.approx(50 * math.sqrt(2))


def test_a_timeline_remembers_the_past_after_a_brake() -> None:
    timeline = Timeline((0.0, 0.0, 0.0))
    timeline.append(line(0, (0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 10.0, ACCELERATION))
    rest_ns = timeline.brake(2 * S, 100.0)
    assert rest_ns == pytest.approx(2.1 * S)
    places = [timeline.position(round(t * S))[0] for t in (1.0, 2.0, 2.1, 99.0)]
    assert places == pytest.approx([9.5, 19.5, 20.0, 20.0])


def test_a_free_tip_feels_nothing_above_the_gel_and_beside_it() -> None:
    assert pressed(-0.01).wrench_at(0) == pytest.approx((0,) * 6)
    assert pressed(2.0, x=-60 - 16.1).wrench_at(0) == pytest.approx((0,) * 6)
    assert pressed(2.0, x=-60 - 16.1).presses_at(0) == ()


def test_pressing_pushes_the_sensor_up_with_the_force_of_the_table() -> None:
    fx, fy, fz, tx, ty, tz = pressed(1.0).wrench_at(0)
    assert fz == pytest.approx(coarse_table().force_at(1.0))
    assert fz > 0.3
    assert (fx, fy, tx, ty, tz) == pytest.approx((0, 0, 0, 0, 0))


def test_a_press_is_reported_in_coordinates_of_the_gel() -> None:
    (press,) = pressed(0.5, x=-57.0, y=-64.0).presses_at(0)
    assert (press.x_mm, press.y_mm, press.depth_mm) == pytest.approx((3.0, -4.0, 0.5))


def test_on_a_tilted_gel_the_depth_is_along_the_normal_and_the_force_leans() -> None:
    """A surface that rises by 0.1 mm per mm of x, pressed 1 mm deep at its centre: depth 1/√1.01."""
    tilted = pressed(1.0, slope_x=0.1)
    (press,) = tilted.presses_at(0)
    assert press.depth_mm == pytest.approx(1 / math.sqrt(1.01))
    fx, _, fz, _, ty, _ = tilted.wrench_at(0)
    assert fx / fz == pytest.approx(-0.1)
    assert ty == pytest.approx(-0.060 * fx)  # the tip is 60 mm below the sensor: T = r x F, r = (0, 0, -0.06)


def test_the_height_of_a_tilted_gel_changes_along_it() -> None:
    assert pressed(0.0, x=-50.0, slope_x=0.02).press_at(0).depth_mm == pytest.approx(0.2, abs=1e-4)


def test_a_crash_meets_the_stiff_layer() -> None:
    force = pressed(7.0).force_at(0) - pressed(6.5).force_at(0)
    assert force == pytest.approx(0.5 * STIFF_N_PER_MM)


def test_a_stuck_axis_stays_and_its_steps_are_lost() -> None:
    machine = world(start_mm=(0.0, 0.0, 0.0))
    machine.go((-10.0, 0.0, -10.0), 10.0, 0)
    machine.stick(2, S // 2)
    machine.stick(2, S, stuck=False)
    x, _, z = machine.tip_at(100 * S)
    lost = machine.motor_at(S)[2] - machine.motor_at(S // 2)[2]
    assert x == pytest.approx(-10.0)
    assert z == pytest.approx(-10.0 - lost)
    assert lost < -3
    assert machine.tip_at(S // 4)[2] == pytest.approx(machine.motor_at(S // 4)[2])  # the past does not change


def test_the_line_is_low_before_its_first_edge_and_equal_levels_are_no_edges() -> None:
    machine = world()
    for level, time_ns in ((False, 1), (True, 10), (True, 20), (False, 30)):
        machine.set_line(level, time_ns)
    assert machine.line_edges() == (Edge(10, True), Edge(30, False))
    assert [machine.line_level(t) for t in (0, 9, 10, 29, 30)] == [False, False, True, True, False]


def test_moves_queue_up_and_a_brake_forgets_those_to_come() -> None:
    machine = world(start_mm=(0.0, 0.0, 0.0))
    machine.go((-10.0, 0.0, 0.0), 10.0, 0)
    end_ns = machine.go((-20.0, 0.0, 0.0), 10.0, 0)
    assert machine.motor_at(end_ns)[0] == pytest.approx(-20.0)
    machine.brake(S // 2, 200.0)
    assert -10.0 < machine.motor_at(end_ns)[0] < 0.0


SETTLING = Gel(settling_share=0.2, settling_s=0.4)


def held(depth_mm: float = 1.0) -> tuple[World, int]:
    """A world whose gel settles, pressed at 10 mm/s; and when the tip came to rest."""
    machine = World(WorldSettings(start_mm=(-60.0, -60.0, -29.0)), SETTLING, coarse_table())
    return machine, machine.go((-60.0, -60.0, -30.0 - depth_mm), 10.0, S)


def test_a_held_press_settles_to_the_force_of_the_table() -> None:
    """What a standard linear solid has beyond its settled force falls by e in each 0.4 s."""
    machine, rest_ns = held()
    settled = coarse_table().force_at(1.0)
    beyond = [machine.force_at(rest_ns + round(t * S)) - settled for t in (0.0, 0.4, 3.2)]
    assert beyond[0] > 0.1 * settled
    assert beyond[1] / beyond[0] == pytest.approx(math.exp(-1), rel=0.01)
    assert beyond[2] < 0.001 * settled


def test_a_sensor_that_asks_for_the_past_of_a_settling_gel_hears_what_was_felt_then() -> None:
    times = [S + round(step * S / 37) for step in range(80)]
    forwards, _ = held()
    backwards, _ = held()
    felt = [forwards.force_at(each) for each in times]
    assert [backwards.force_at(each) for each in reversed(times)] == felt[::-1]


def test_a_tip_that_leaves_a_settling_gel_leaves_a_dent_that_the_camera_sees() -> None:
    machine, rest_ns = held()
    up_ns = machine.go((-60.0, -60.0, -29.0), 50.0, rest_ns + 2 * S)
    (dent,) = machine.presses_at(up_ns)
    assert machine.force_at(up_ns) == 0
    assert 0.1 < dent.depth_mm < 0.5
    assert machine.presses_at(up_ns + 10 * S) == ()


def test_steps_of_a_motor_make_no_new_place_in_a_settling_gel() -> None:
    machine, rest_ns = held()
    machine.go((-60.0 + 1e-4, -60.0, -31.0), 10.0, rest_ns)
    assert len(machine.presses_at(rest_ns + S)) == 1


def test_the_world_presses_with_the_indenter_that_it_was_reported() -> None:
    ball = World(WorldSettings(start_mm=(-60.0, -60.0, -30.5), indenter='ball'))
    (press,) = ball.presses_at(0)
    assert press.indenter == 'ball'
    # Hertz: at the same depth the force goes with the root of the radius, sqrt(3 / 0.6) = 2.2, and more in a layer.
    assert ball.force_at(0) > 2.2 * World(WorldSettings(start_mm=(-60.0, -60.0, -30.5))).force_at(0)


def test_a_gel_is_named_by_the_settings() -> None:
    assert World(WorldSettings(gel='lifelike'), table=coarse_table()).gel.exposure_s == 0.008
