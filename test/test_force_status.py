"""How long a reason stays."""

from __future__ import annotations

from tactile_nodes.force_status import StillUnlike


def test_a_contact_that_was_unlike_the_training_stays_so_for_four_tenths_of_a_second() -> None:
    still = StillUnlike()
    course = [(0, False), (100, True), (200, False), (500, False), (501, False), (600, True), (650, False)]
    told = [still.told(ms * 1_000_000, unlike=unlike, touching=True) for ms, unlike in course]
    assert told == [False, True, True, True, False, True, True]


def test_the_next_contact_is_judged_anew_and_so_are_stamps_that_go_back() -> None:
    still = StillUnlike()
    assert still.told(100, unlike=True, touching=True)
    assert not still.told(200, unlike=False, touching=False)
    assert not still.told(300, unlike=False, touching=True)
    assert still.told(400, unlike=True, touching=True)
    assert not still.told(350, unlike=False, touching=True)
