"""What holds from a stamp on."""

from __future__ import annotations

from tactile_nodes.sensing.judge.stamped import ByStamp


def test_a_value_holds_from_its_stamp_on_in_whatever_order_frames_come() -> None:
    values = ByStamp(0)
    values.add(10, 1)
    values.add(20, 2)
    assert [values.at(stamp) for stamp in (1000, 9, 19, 20, 10)] == [2, 0, 1, 2, 1]


def test_a_recording_that_begins_again_takes_the_place_of_what_came_after() -> None:
    values = ByStamp(0)
    values.add(10, 1)
    values.add(20, 2)
    values.add(10, 3)
    assert [values.at(stamp) for stamp in (9, 10, 30)] == [0, 3, 3]


def test_a_thousand_values_are_not_all_kept() -> None:
    values = ByStamp(0)
    for stamp in range(1000):
        values.add(stamp, stamp)
    assert values.at(999) == 999
    assert values.at(950) == 950
    assert values.at(0) == 899  # the last of those that were let go stands for all before
