"""How the stability benchmark counts: streams made by hand, with the numbers that follow from them."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest

from benchmarks.stability.aims import AIMS, Point, losers
from benchmarks.stability.scores import DEGRADED, INVALID, OK, Answer, score
from benchmarks.stability.stream import (
    AFTER,
    BEFORE,
    CAPTURE,
    DURING,
    HELD,
    REST,
    Change,
    Moment,
    Plan,
    always,
    course,
    random_presses,
)
from benchmarks.stability.times import caught_once, doubled, dropped, jumped, pressed_slowly, reordered
from tactile_nodes.messages import types
from tactile_nodes.simulation.optics import Press

PRESS = (Press(1.0, 2.0, 1.0),)
FOREIGN = types.ForceDistribution.REASON_FOREIGN_MOTION


def answer(
    part: str, kind: str, *, total_n: float = 0.0, status: int = OK, touching: bool = False, **more: object
) -> Answer:
    held = kind == HELD
    moment = Moment(0, part, kind, PRESS if held else ())
    places = ((1.0, 2.5),) if touching else ()
    made = Answer(moment, 0.5 if held else 0.0, status, 0, total_n, 0.01, touching, places, 0.01)
    return dataclasses.replace(made, **more)  # type: ignore[arg-type]


def held(total_n: float, status: int = OK, *, touching: bool = True) -> Answer:
    return answer(DURING, HELD, total_n=total_n, status=status, touching=touching)


def rest(total_n: float, status: int = OK, *, touching: bool = False) -> Answer:
    return answer(DURING, REST, total_n=total_n, status=status, touching=touching)


def test_errors_are_over_held_frames_and_again_over_those_that_say_ok() -> None:
    found = score([rest(9.0), held(0.8), held(0.1, DEGRADED)])
    assert found.rmse_n == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2))
    assert found.rmse_ok_n == pytest.approx(0.3)
    assert found.worst_ok_n == pytest.approx(0.3)
    assert (found.times, found.times_ok) == pytest.approx((100 * found.rmse_n, 30.0))  # 10 mN are usual
    assert found.held_ok == 0.5


def test_of_each_press_the_first_held_frame_is_reported_apart() -> None:
    frames = [held(total_n) for total_n in (0.8, 0.5, 0.9, 0.5)]
    presses = (0, 0, 1, 1)
    some = [
        dataclasses.replace(each, moment=dataclasses.replace(each.moment, press=press))
        for each, press in zip(frames, presses, strict=True)
    ]
    found = score(some)
    assert found.first_rmse_n == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2))
    assert found.rmse_n == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 4))


def test_what_is_pressed_slowly_ends_where_it_would_be_held() -> None:
    plan = Plan(presses=1, hold=3, fps=20.0)
    depths = [each.presses[0].depth_mm for each in pressed_slowly(course(plan, [PRESS]), 0.2) if each.kind == HELD]
    assert depths == pytest.approx([0.98, 0.99, 1.0])


def test_a_false_contact_is_a_force_reported_as_contact_at_rest_and_ok_ones_are_counted_apart() -> None:
    found = score([rest(0.3), rest(0.1, DEGRADED, touching=True), rest(0.04, touching=True), held(0.5)])
    assert (found.rest_n, found.false_n, found.false_ok_n) == (0.3, 0.1, 0.04)
    assert found.false_share == pytest.approx(2 / 3)


def test_a_contact_is_missed_when_none_is_reported_for_it() -> None:
    found = score([held(0.5), held(0.5, touching=False)])
    assert found.missed == 0.5
    assert found.place_mm == pytest.approx(0.5)


def test_a_force_without_a_number_is_no_error_and_is_counted() -> None:
    found = score([held(math.nan, INVALID, touching=False), held(0.6)])
    assert found.rmse_n == pytest.approx(0.1)
    assert found.without_number == 0.5


def test_frames_are_counted_from_the_cause_and_from_its_end() -> None:
    during = [rest(0.0), rest(0.0, DEGRADED), rest(0.0, INVALID), held(0.5)]
    after = [answer(AFTER, REST, status=each) for each in (INVALID, INVALID, DEGRADED, OK)]
    found = score([answer(BEFORE, REST, status=INVALID), *during, *after])
    assert (found.until_said, found.until_invalid, found.until_left) == (2, 3, 2)


def test_what_is_there_only_in_contact_is_caused_by_the_first_contact() -> None:
    found = score([rest(0.0), rest(0.0), held(0.5), held(0.5, DEGRADED)], Change(contact=True))
    assert found.until_said == 2


def test_what_grows_is_invalid_from_where_it_goes_beyond_use() -> None:
    during = [rest(0.0), rest(0.0, DEGRADED), rest(0.0, DEGRADED), held(0.5, DEGRADED), rest(0.0, INVALID)]
    course = [
        dataclasses.replace(each, moment=dataclasses.replace(each.moment, number=n)) for n, each in enumerate(during)
    ]
    found = score(course, Change(beyond=lambda moment: moment.number >= 3))
    assert (found.until_said, found.until_invalid) == (2, 2)


def test_a_contact_that_begins_says_nothing_of_a_cause() -> None:
    begun = dataclasses.replace(held(0.5, DEGRADED), reasons=types.ForceDistribution.REASON_BEGINNING)
    assert score([rest(0.0), begun, held(0.5)]).until_said is None
    assert score([rest(0.0), dataclasses.replace(begun, reasons=begun.reasons | FOREIGN)]).until_said == 2


def test_what_is_in_the_rest_image_counts_to_the_end_and_is_never_left() -> None:
    first = answer(BEFORE, CAPTURE, status=INVALID)
    found = score([first, answer(BEFORE, REST, status=DEGRADED), held(0.5), answer(AFTER, REST)], Change(acts=always))
    assert (found.until_said, found.until_left) == (1, None)
    assert found.invalid == 0


def test_reasons_are_shares_of_frames() -> None:
    found = score([rest(0.0), dataclasses.replace(held(0.5), reasons=FOREIGN)])
    assert found.reasons == {'foreign motion': 0.5}


def point(ratio: float, *, false_n: float = 0.0, level: float = 1.0, invalid: float = 0.0, **more: object) -> Point:
    made = dataclasses.asdict(score([rest(0.0), held(0.5 + 0.01 * ratio)]))
    made |= {'false_ok_n': false_n, 'held_invalid': invalid, **more}
    undisturbed = dataclasses.asdict(score([rest(0.0), held(0.51)]))
    return Point('fast', 'geometry', 'camera shifted', 'px', level, True, made, undisturbed)


def test_a_point_holds_within_one_and_a_half_times_or_the_nominal_error_and_only_where_its_force_may_be_used() -> None:
    assert point(1.4).holds
    assert not point(1.6).holds
    assert not point(1.0, invalid=0.2).holds
    assert point(3.0, times=0.9).holds  # within the nominal error


def test_aims_count_the_points_that_hold_and_name_the_worst() -> None:
    points = [point(1.4, level=0.3), point(3.0, level=1.0, false_n=0.05)]
    shifted = AIMS['camera shifted up to 3 px: error within 1.5x, or nominal'](points)
    assert shifted is not None
    assert (shifted.held, shifted.judged) == (1, 2)
    assert 'camera shifted, 1 px' in shifted.worst
    false = AIMS['no false contact above 20 mN with status ok'](points)
    assert false is not None
    assert (false.held, false.judged) == (1, 2)
    assert AIMS['blur up to 1 px: error within 1.5x, or nominal'](points) is None


def test_losers_are_those_that_are_wrong_and_say_ok_or_should_hold() -> None:
    (line,) = losers([point(1.0), point(3.0, level=2.0), point(1.0, level=3.0, false_n=0.03)])
    assert line.startswith('camera shifted: 2 px (3.0x the nominal error with status ok')
    assert '3 px (a false contact of 30 mN' in line
    assert '1 px' not in line


def moments() -> list[Moment]:
    plan = Plan(presses=3)
    return course(plan, random_presses(plan))


def test_a_stream_rests_before_between_and_after_its_presses_and_is_evenly_stamped() -> None:
    plan, made = Plan(presses=3), moments()
    kinds = [each.kind for each in made if each.part == DURING]
    assert kinds.count(HELD) == 3 * plan.hold
    assert kinds[: plan.coming] == [REST] * plan.coming
    assert {b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(made)} == {50_000_000}


def test_times_change_order_count_and_stamps_and_nothing_else() -> None:
    made = moments()
    during = [each for each in made if each.part == DURING]
    assert len([each for each in dropped(made, 50) if each.part == DURING]) < len(during)
    assert [each for each in dropped(made, 50) if each.part != DURING] == [each for each in made if each.part != DURING]
    twice = doubled(made, 50)
    assert len(twice) > len(made)
    assert list(dict.fromkeys(twice)) == made
    late = reordered(made, 2)
    assert sorted(late, key=lambda each: each.number) == made
    assert [each.number for each in late] != [each.number for each in made]
    off = [b.stamp_ns - a.stamp_ns for a, b in zip(made, jumped(made, -60.0), strict=True)]
    assert set(off) == {0, -60_000_000_000}


def test_a_tip_that_is_caught_once_was_as_far_above_as_it_came() -> None:
    """20 frames a second: at 10 mm/s it was 0.5 mm higher in the frame before, at 100 mm/s above the gel."""
    for speed_mm_s, above_mm in ((10.0, 0.5), (100.0, 5.0)):
        made = caught_once(moments(), speed_mm_s)
        held = [each for each in made if each.kind == HELD]
        before = [made[made.index(each) - 1] for each in held]
        assert len(held) == 3
        apart = [each.presses[0].depth_mm - was.presses[0].depth_mm for each, was in zip(held, before, strict=True)]
        assert apart == pytest.approx([above_mm] * 3)
        assert any(each.touching for each in before) == (speed_mm_s < 50)
