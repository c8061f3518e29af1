"""When a rest image is taken anew: never of a touch, at once after a change of light, slowly otherwise."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.rest.renewal import Renewal, RenewalOptions, Rested

S = 1_000_000_000
IMAGE = np.full((4, 4), 90, np.uint8)
STILL = Rested(surely=True, maybe=True, like=True, changed=False)
DIMMER = Rested(surely=False, maybe=True, like=False, changed=True)
TOUCHED = Rested(surely=False, maybe=False, like=False, changed=True)
TOUCHED_BESIDE = Rested(surely=False, maybe=False, like=False, changed=False)
CREPT = Rested(surely=True, maybe=True, like=False, changed=False)


def renewed(frames: list[Rested], fps: float = 30.0) -> list[int]:
    """Numbers of the frames that completed a rest image."""
    renewal = Renewal(RenewalOptions(frames=8, least_s=0.2, after_s=60.0))
    renewal.taken(0, renewed=False)
    stamps = [round((number + 1) / fps * S) for number in range(len(frames))]
    offered = [renewal.offer(IMAGE, at_ns, each) for at_ns, each in zip(stamps, frames, strict=True)]
    return [number for number, image in enumerate(offered) if image is not None]


def test_another_light_renews_the_rest_image_once_eight_frames_show_it() -> None:
    assert renewed([STILL] * 4 + [DIMMER] * 8) == [11]


def test_a_touch_begins_the_count_anew_and_ends_the_calm() -> None:
    assert renewed([STILL] * 4 + [DIMMER] * 4 + [TOUCHED] + [DIMMER] * 20) == []
    assert renewed([STILL] * 4 + [TOUCHED] + [STILL] + [DIMMER] * 8) == [13]


def test_what_creeps_is_renewed_after_a_minute_and_only_while_it_is_surely_at_rest() -> None:
    assert renewed([CREPT] * 80, fps=1.0)[0] == 66  # the 60th s is frame 59, and it takes eight
    assert renewed([Rested(surely=False, maybe=True, like=False, changed=False)] * 80, fps=1.0) == []


def test_a_picture_like_the_rest_image_renews_nothing() -> None:
    assert renewed([STILL] * 200, fps=1.0) == []


def test_frames_that_were_straightened_by_something_else_are_not_averaged() -> None:
    renewal = Renewal(RenewalOptions(frames=4, least_s=0.1))
    renewal.taken(0, renewed=False)
    one, other = object(), object()
    by = [one, one, other, other, other, other]
    found = [renewal.offer(IMAGE, number * S // 30, DIMMER, each) for number, each in enumerate(by, 1)]
    assert [image is not None for image in found] == [False] * 5 + [True]


def test_a_picture_that_goes_on_changing_is_renewed_less_and_less_often() -> None:
    renewal, at_s = Renewal(RenewalOptions(frames=1, least_s=0.0, apart_s=2.0, after_s=60.0)), []
    renewal.taken(0, renewed=False)
    for number in range(1, 600):
        if renewal.offer(IMAGE, number * S // 2, DIMMER) is not None:
            renewal.taken(number * S // 2, renewed=True)
            at_s.append(number / 2)
    assert at_s[:6] == [0.5, 2.5, 6.5, 14.5, 30.5, 62.5]
    assert at_s[7] - at_s[6] == 60.0


def test_a_renewed_rest_image_is_taken_once_more_of_frames_at_rest_touches_between_them_or_not() -> None:
    renewal, found = Renewal(RenewalOptions(frames=4, least_s=0.1, refined=(6,))), []
    renewal.taken(0, renewed=False)
    course = [DIMMER] * 4 + [STILL, TOUCHED_BESIDE, CREPT, STILL] * 4
    for number, each in enumerate(course, 1):
        image = renewal.offer(np.full((4, 4), 50 + 2 * number, np.uint8), number * S // 30, each)
        if image is not None:
            renewal.taken(number * S // 30, renewed=True)
            found.append((number, int(image[0, 0])))
    # Frames 1 to 4, 2.5 in the mean, and 5, 7, 8, 9, 11 and 12, which are 8.67.
    assert found == [(4, 55), (12, 67)]


def test_a_renewed_rest_image_is_taken_of_more_and_more_frames_at_rest() -> None:
    """Of four frames, of the next six, and of these and four more; then of no more."""
    renewal, found = Renewal(RenewalOptions(frames=4, least_s=0.1, refined=(6, 10))), []
    renewal.taken(0, renewed=False)
    for number, each in enumerate([DIMMER] * 4 + [STILL] * 60, 1):
        image = renewal.offer(np.full((4, 4), 50 + 2 * number, np.uint8), number * S // 30, each)
        if image is not None:
            renewal.taken(number * S // 30, renewed=True)
            found.append((number, int(image[0, 0])))
    # Means of the numbers 1 to 4, 5 to 10 and 5 to 14.
    assert found == [(4, 55), (10, 65), (14, 69)]


def test_a_captured_rest_image_and_a_refined_one_are_not_taken_once_more() -> None:
    renewal = Renewal(RenewalOptions(frames=4, least_s=0.1, refined=(6,)))
    renewal.taken(0, renewed=True)  # the captured one, which has returned
    assert all(renewal.offer(IMAGE, number * S // 30, STILL) is None for number in range(1, 60))
