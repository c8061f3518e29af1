"""Snapshots of a hand as text."""

from __future__ import annotations

import math

from seen import MS, force, received

from tactile_nodes import conversions
from tactile_nodes.cli.view import hand
from tactile_nodes.messages import types
from tactile_nodes.viewing.state import Snapshot, ViewState

INVALID = types.ForceDistribution.STATUS_INVALID


def seen(*, missing: tuple[str, ...] = (), late_ms: float = 0.0) -> Snapshot:
    """Left 0.75 N, right invalid, thumb not heard of yet; the left one's contacts have margins of 0.4 and 0.9."""
    state = ViewState()
    names = ('left', 'right', 'thumb')
    left, right, _ = (state.add_sensor(f'/{name}', 0) for name in names)
    for number in range(3):
        left.add_force(received(force(10 * number, (0.0, 0.75, 0.0, 0.0), (1.0, -2.0)), 10 * number + 4))
    right.add_force(received(force(10, (0.0, 0.0, 0.0, 0.0), status=INVALID), 24))
    margins = [types.GraspMargin(sensor='left', margin=value) for value in (0.9, 0.4, math.nan)]
    sum_n = types.Wrench(force=types.Vector3(x=0.1, y=0.2, z=-0.3), torque=types.Vector3(x=0.0, y=0.0125, z=0.0))
    head = conversions.header(10 * MS, 'gripper')
    wrench = types.HandWrench(header=head, wrench=sum_n, sensors=['left'], missing=list(missing), margins=margins)
    state.add_wrench(received(wrench, 24))
    return state.snapshot(round((30 + late_ms) * MS))


def test_each_sensor_has_a_row_and_the_sum_its_line() -> None:
    lines = hand.picture(seen(missing=('right', 'thumb'))).plain.splitlines()
    rows = {words[0]: words for line in lines if (words := line.split())}
    assert rows['left'][1:] == ['100.0', '0.750', '0.000', '(', '+1.00,', '-2.00)', 'mm', '0.40', 'OK']
    assert rows['right'][-1].startswith('INVALID')
    assert rows['thumb'][-1] == 'waiting'
    assert ' '.join(rows['sum']) == (
        'sum force +0.100 +0.200 -0.300 N without right, thumb torque +0.0000 +0.0125 +0.0000 N m in gripper'
    )


def test_a_terminal_of_80_columns_shows_which_sensors_the_sum_lacks() -> None:
    (line,) = (line for line in hand.picture(seen(missing=('right', 'thumb'))).plain.splitlines() if line[:3] == 'sum')
    assert 'without right, thumb' in line[:79]


def test_a_sensor_that_falls_silent_is_reported() -> None:
    (row,) = (line for line in hand.picture(seen(late_ms=2000.0)).plain.splitlines() if line.startswith('left'))
    assert 'no force for 2.0 s, the last was OK' in row


def test_a_sum_that_came_longer_ago_than_a_second_is_not_shown_nor_are_its_margins() -> None:
    for late_ms, shown in ((990.0, True), (1000.0, False)):  # it came 6 ms before
        lines = hand.picture(seen(late_ms=late_ms)).plain.splitlines()
        assert any('force +0.100' in line for line in lines) is shown
        assert any('0.40' in line for line in lines) is shown
    assert 'sum no data: nothing comes on hand_wrench' in hand.line(seen(late_ms=1000.0))


def test_a_line_and_the_summary_hold_the_same() -> None:
    shot = seen()
    assert 'left 0.750 N OK  right 0.000 N INVALID' in hand.line(shot)
    assert 'thumb waiting  sum force +0.100' in hand.line(shot)
    assert [line.split()[:2] for line in hand.summary(shot).splitlines()[1:]] == [
        ['left', '3'],
        ['right', '1'],
        ['thumb', '0'],
    ]
