"""The sum of a hand's sensors, fed by hand: which forces belong together, and what they come to."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tactile_nodes import conversions
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.pipeline.hand_forces import REPLAYED, HandForces
from tactile_nodes.sensors import Hand, HandSensor, Mounting

MS = 1_000_000
FORCE = types.ForceDistribution
START = 1_000_000 * MS


def facing(name: str, y_mm: float, roll_deg: float) -> HandSensor:
    return HandSensor(name, frame=Mounting(name, 'grip', (0.0, y_mm, 80.0), (roll_deg, 0.0, 0.0)))


HAND = Hand('grip', 60.0, 0.8, (facing('left', 30.0, 90.0), facing('right', -30.0, -90.0)))


def pressed(
    at_ms: float, normal_n: float, shear_x_n: float = 0.0, status: int = FORCE.STATUS_OK, known: bool = True
) -> types.ForceDistribution:
    """Pressed at the middle of the gel, and dragged along its x; each component unsure by 0.01 N."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * 1e-4
    covariance[0, 0] = covariance[0, 0] if known else -1.0
    return FORCE(
        header=conversions.header(START + round(at_ms * MS), 'x'),
        wrench=types.Wrench(force=types.Vector3(x=shear_x_n, y=0.0, z=-normal_n)),
        wrench_covariance=covariance.reshape(-1), status=status,
        contacts=[types.Contact(force=normal_n, shear_x=shear_x_n, shear_y=0.0, slip_share=0.25)],
    )  # fmt: skip


def sums(forces: HandForces, *given: tuple[str, types.ForceDistribution]) -> list[types.HandWrench]:
    return [made for name, force in given for made in forces.add(name, force)]


def test_a_gripped_part_presses_both_fingers_apart_and_its_weight_stays() -> None:
    # 2 N into each gel cancel. Each finger is dragged by 0.5 N along its x, which is the hand's x: 1 N in all, at a
    # height of 80 mm, so 0.08 N m about y. About z the levers of 30 mm to both sides cancel.
    (made,) = sums(HandForces(HAND), ('left', pressed(0, 2.0, 0.5)), ('right', pressed(3, 2.0, 0.5)))
    pull, turn = made.wrench.force, made.wrench.torque
    assert (pull.x, pull.y, pull.z) == pytest.approx((1.0, 0.0, 0.0))
    assert (turn.x, turn.y, turn.z) == pytest.approx((0.0, 0.08, 0.0))
    assert (made.header.frame_id, stamp_ns(made.header.stamp)) == ('grip', START + 3 * MS)
    assert (made.sensors, made.missing) == (['left', 'right'], [])


def test_variances_of_the_sensors_add_up_with_their_levers() -> None:
    # Two of 1e-4 N^2. About x, force along y has a lever of 80 mm, and along z one of 30 mm.
    (made,) = sums(HandForces(HAND), ('left', pressed(0, 2.0)), ('right', pressed(3, 2.0)))
    covariance = np.asarray(made.wrench_covariance).reshape(6, 6)
    assert np.diag(covariance)[:3] == pytest.approx([2e-4] * 3)
    assert covariance[3, 3] == pytest.approx(2e-4 * (0.08**2 + 0.03**2))
    assert covariance == pytest.approx(covariance.T)


def test_the_contact_that_slips_first_is_the_first() -> None:
    # 0.4 of 0.8 N, and 0.6 of 0.8 N.
    (made,) = sums(HandForces(HAND), ('left', pressed(0, 1.0, 0.4)), ('right', pressed(3, 1.0, 0.6)))
    assert [(each.sensor, each.margin) for each in made.margins] == [
        ('right', pytest.approx(0.25)),
        ('left', pytest.approx(0.5)),
    ]
    assert made.margins[1].position.y == pytest.approx(0.03)


def test_without_friction_the_larger_slip_share_goes_first() -> None:
    hand = Hand('grip', 60.0, 0.0, HAND.sensors)
    slipping = pressed(3, 1.0)
    slipping.contacts[0].__dict__['slip_share'] = 0.75
    (made,) = sums(HandForces(hand), ('left', pressed(0, 1.0)), ('right', slipping))
    assert [each.sensor for each in made.margins] == ['right', 'left']
    assert math.isnan(made.margins[0].margin)


def test_a_sensor_that_falls_silent_is_awaited_for_three_frames_and_then_no_more() -> None:
    forces = HandForces(HAND)
    sums(forces, ('left', pressed(0, 1.0)), ('right', pressed(8, 1.0)))
    made = [sums(forces, ('left', pressed(16.7 * frame, 1.0))) for frame in range(1, 7)]
    stamps = [[round((stamp_ns(each.header.stamp) - START) / MS, 1) for each in due] for due in made]
    assert stamps == [[], [], [], [16.7, 33.4, 50.1, 66.8], [83.5], [100.2]]
    assert {tuple(each.missing) for due in made for each in due} == {('right',)}


NOBODY: list[str] = []
RIGHT = ['right']


@pytest.mark.parametrize(
    ('came', 'sums_ms', 'missing'),
    [
        # What the right finger felt at 59 ms belongs to the left one's 67 ms.
        pytest.param(
            'left 0, right 8, left 17, left 33, left 50, left 67, right 59, left 83, right 75',
            [8, 17, 33, 50, 67, 83], [NOBODY, RIGHT, RIGHT, RIGHT, RIGHT, NOBODY], id='four frames late',
        ),
        # The second of the right finger comes only after the fourth of the left one.
        pytest.param(
            'left 0, right 8, left 17, left 34, left 51, right 25, right 42', [8, 25, 42], [NOBODY, NOBODY, NOBODY],
            id='late by a frame or two',
        ),
        # The left finger's second picture came 2 ms before the first sum's newest, and the right one's is lost.
        pytest.param(
            'left 0, right 16, left 14, right 47, left 33, left 50', [16, 47], [NOBODY, NOBODY],
            id='stamps never step back',
        ),
        pytest.param(
            'left 0, right 8, left 17, left 34, right 42', [8, 17, 42], [NOBODY, RIGHT, NOBODY], id='a picture was lost'
        ),
    ],
)  # fmt: skip
def test_forces_that_are_late_or_lost_are_in_their_sum_or_missing_from_it_alone(
    came: str, sums_ms: list[int], missing: list[list[str]]
) -> None:
    order = [each.split() for each in came.split(', ')]
    made = sums(HandForces(HAND), *((name, pressed(float(at_ms), 1.0)) for name, at_ms in order))
    assert [round((stamp_ns(each.header.stamp) - START) / MS) for each in made] == sums_ms
    assert [each.missing for each in made] == missing


@pytest.mark.parametrize('ahead', [0, 2])
def test_a_recording_that_begins_again_is_summed_again(ahead: int) -> None:
    """Also if the left finger begins again while the last two forces of the right one are still to come.

    Then its first three are not summed with the last ones of the right finger, but alone.
    """
    left, right = ([(name, pressed(17 * frame, 1.0)) for frame in range(120)] * 2 for name in ('left', 'right'))
    both = [force for pair in zip(left[ahead:], right, strict=False) for force in pair]
    made = sums(HandForces(HAND), *left[:ahead], *both, *right[240 - ahead :])
    whole = [stamp_ns(each.header.stamp) for each in made if not each.missing]
    assert whole[-117:] == [START + 17 * frame * MS for frame in range(3, 120)]
    assert len(whole) >= 117 + 118


def test_in_a_replay_nothing_waits_for_a_sensor_whose_last_picture_was_answered() -> None:
    """Live the right finger fell silent; what the left one felt afterwards, to its last, is summed as well."""
    last_ns = {'left': START + 1000 * MS, 'right': START + 108 * MS}
    forces = HandForces(HAND, REPLAYED, last_ns)
    made = sums(forces, *(('left', pressed(at_ms, 1.0)) for at_ms in range(0, 1001, 100)))
    assert made == []  # the right one may still come
    made = sums(forces, ('right', pressed(8, 1.0)), ('right', pressed(108, 1.0)))
    assert [round((stamp_ns(each.header.stamp) - START) / MS) for each in made] == [8, 108, *range(200, 1001, 100)]
    assert [each.missing for each in made] == 2 * [[]] + 9 * [['right']]


def test_in_a_replay_nothing_waits_for_a_sensor_that_the_bag_does_not_hold() -> None:
    forces = HandForces(HAND, REPLAYED, {'left': START + 1000 * MS})
    made = sums(forces, *(('left', pressed(at_ms, 1.0)) for at_ms in (0, 17)))
    assert [each.missing for each in made] == [['right'], ['right']]


def test_a_contact_that_was_read_as_a_tip_is_not_dragged_as_surely_as_the_wrench_says() -> None:
    # 1 N and a friction of 0.8: 0.01 N of shear are 0.0125 of what holds.
    contact = types.Contact(force=1.0, shear_x=math.nan, shear_y=math.nan, shear_sigma=math.nan)
    tip = replace(pressed(0, 1.0), explanation=FORCE.EXPLANATION_TIPS, contacts=[contact])
    (made,) = sums(HandForces(HAND), ('left', tip), ('right', pressed(3, 1.0, 0.4)))
    assert [each.sensor for each in made.margins] == ['right', 'left']
    assert (made.margins[1].margin, made.margins[1].margin_sigma) == (1.0, pytest.approx(0.0125))


def test_a_sensor_that_is_back_is_in_the_sum_again() -> None:
    forces = HandForces(HAND)
    sums(forces, *(('left', pressed(16.7 * frame, 1.0)) for frame in range(6)))
    made = sums(
        forces, *((name, pressed(100 + 16.7 * frame + ms, 1.0)) for frame in range(4)
                  for name, ms in (('left', 0), ('right', 8)))
    )  # fmt: skip
    assert made[-1].missing == []


def test_what_comes_long_after_its_time_is_not_summed_with_what_is_new() -> None:
    forces = HandForces(HAND)
    sums(forces, ('left', pressed(0, 1.0)), ('right', pressed(3, 1.0)))
    assert sums(forces, ('right', pressed(-40, 9.0)), ('left', pressed(16.7, 1.0))) == []
    (made,) = sums(forces, ('right', pressed(19.7, 1.0)))
    assert made.wrench.force.y == pytest.approx(0.0)


@pytest.mark.parametrize('bad', [{'status': FORCE.STATUS_INVALID}, {'known': False}])
def test_a_force_that_cannot_be_used_is_missing_from_the_sum(bad: dict[str, int]) -> None:
    (made,) = sums(HandForces(HAND), ('left', pressed(0, 1.0, **bad)), ('right', pressed(3, 1.0)))
    assert (made.sensors, made.missing) == (['right'], ['left'])
    assert made.wrench.force.y == pytest.approx(-1.0)


def test_a_sum_of_nothing_is_not_zero_but_unknown() -> None:
    bad = {'status': FORCE.STATUS_INVALID}
    (made,) = sums(HandForces(HAND), ('left', pressed(0, 1.0, **bad)), ('right', pressed(3, 1.0, **bad)))
    assert math.isnan(made.wrench.force.x)
    assert made.wrench_covariance[0] == -1.0
    assert made.margins == []


def test_sums_of_a_replay_are_those_of_the_live_run_whichever_sensor_runs_ahead() -> None:
    left = [('left', pressed(17 * number, 1.0 + number)) for number in range(8)]
    right = [('right', pressed(17 * number + 3, 2.0 + number)) for number in range(8)]
    live = sums(HandForces(HAND), *(each for pair in zip(left, right, strict=True) for each in pair))
    for order in (left + right, right + left, left[:5] + right[:2] + left[5:] + right[2:]):
        found = sums(HandForces(HAND, REPLAYED), *order)
        assert [(stamp_ns(each.header.stamp), each.wrench.force.y) for each in found] == [
            (stamp_ns(each.header.stamp), each.wrench.force.y) for each in live
        ]
        assert all(each.sensors == ['left', 'right'] for each in found)


def test_a_picture_that_one_sensor_lost_is_summed_without_it_in_a_replay() -> None:
    left = [('left', pressed(17 * number, 1.0)) for number in range(4)]
    right = [('right', pressed(17 * number + 3, 2.0)) for number in (0, 1, 3)]
    found = sums(HandForces(HAND, REPLAYED), *left, *right)
    assert [each.missing for each in found] == [[], [], ['right'], []]


def test_a_replay_waits_for_no_sensor_that_is_not_in_the_bag() -> None:
    found = sums(HandForces(HAND, REPLAYED), *(('left', pressed(17 * number, 1.0)) for number in range(REPLAYED + 3)))
    assert len(found) == REPLAYED + 3
    assert all(each.missing == ['right'] for each in found)
    assert found[0].missing == ['right']
