"""Frames in, features and forces out: what is said when the picture is no longer that of the rest image."""

from __future__ import annotations

import copy
import functools

import cv2
import numpy as np
import pytest
from dots import DOTS, grow, picture, press, shift
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_nodes import conversions
from tactile_nodes.messages import types
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.following import Following, FollowingParams

FORCE = types.ForceDistribution
S = 1_000_000_000


class Stream:
    """Frames of dots at 30 a second through the features of `fast`, or of a model."""

    def __init__(self, model: str = 'fast') -> None:
        self.following, self.number = Following(FollowingParams(model=model, reference_frames=4)), 0
        self.following.begin_capture()
        self.announced: list[str] = []
        self.spot: tuple[slice, slice] | None = None
        self.bands_grey = self.blur_px = self.noise_grey = 0.0
        self.at_ns, self.every_ns = S, S // 30

    def feed(self, frames: int, *motions: object, light: float = 1.0, age_s: float = 0.001) -> types.FlowFeatures:
        for _ in range(frames):
            self.number += 1
            image = picture(*motions, number=self.number, light=light)  # type: ignore[arg-type]
            if self.blur_px:
                image = cv2.GaussianBlur(image, (0, 0), self.blur_px)
            if self.noise_grey:
                noise = np.random.default_rng(self.number).normal(0, self.noise_grey, image.shape)
                image = np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)
            if self.spot is not None:
                image[self.spot] //= 6
            if self.bands_grey:
                rows = self.bands_grey * (1 + np.sin(np.arange(len(image)) / 10 + 2 * self.number))
                image = np.minimum(image + rows[:, None], 255).astype(np.uint8)
            self.at_ns += self.every_ns
            head = conversions.header(self.at_ns, 'camera')
            message = self.following.answer(image, head, acquire_s=0.0, waited_s=age_s)
            if self.following.announced() is not None:
                self.announced.append(self.following.reference_id)
        return message


@functools.cache
def _rested(frames: int) -> Stream:
    stream = Stream()
    stream.feed(frames)
    return stream


def at_rest(frames: int = 8) -> Stream:
    """The features of `fast` after so many frames of the untouched gel, of which four made its rest image."""
    return copy.deepcopy(_rested(frames))


def test_why_a_rest_image_cannot_be_used_is_said_until_one_can() -> None:
    """The capture begins anew by itself, and for as long as it lasts nothing else is wrong."""
    following = Following(FollowingParams(reference_frames=4))
    following.begin_capture()
    for number in range(1, 12):
        head = conversions.header(S + number * S // 30, 'camera')
        following.answer(picture(number=number)[:433], head, acquire_s=0.0, waited_s=0.0)
        assert ('10x10 regions do not divide' in following.trouble) == (number >= 4), number


def test_times_of_a_frame_that_was_not_measured_are_unknown() -> None:
    """A frame of the capture is received, but nothing moves in it yet: only those times were measured."""
    stream = Stream()
    stages = stream.feed(1, age_s=0.25).stages
    assert (stages.acquire, stages.transport) == (0.0, 0.25)
    assert np.isnan([stages.flow, stages.features, stages.predict]).all()
    assert stream.feed(5).stages.flow > 0


def test_nothing_is_said_of_frames_as_they_were_and_the_rest_image_stays() -> None:
    stream = at_rest(4)
    assert {stream.feed(1).reasons for _ in range(12)} == {0}
    assert len(stream.announced) == 1


def test_a_rest_image_that_was_touched_is_reported_and_taken_anew_once_nothing_touches() -> None:
    stream, touched = Stream(), press(180, 250, 0.1)
    stream.feed(6, touched)
    assert stream.feed(6).reasons & FORCE.REASON_REST_DOUBTFUL
    stream.feed(16)
    assert len(stream.announced) == 2
    assert {stream.feed(1).reasons for _ in range(12)} == {0}
    motion = stream.feed(1, touched).values
    assert float(np.abs(motion).max()) == pytest.approx(0.1, rel=0.4)  # a region's mean of it


def test_a_press_held_from_the_first_frame_on_is_reported_once_it_is_let_go_however_slowly() -> None:
    """At rest beside itself, and nobody can know more. What was pressed then reads as much as it is."""
    stream, held = Stream(), press(180, 250, 0.5)
    stream.feed(24, held)
    assert stream.following.trouble == ''
    for share in np.linspace(1, 0, 21)[1:]:
        stream.feed(1, press(180, 250, 0.5 * share))
    doubtful = [stream.feed(1).reasons & FORCE.REASON_REST_DOUBTFUL for _ in range(29)]
    assert any(doubtful)
    stream.every_ns = S // 10
    stream.feed(27)  # taken while it was let go, it is taken anew two seconds later
    assert stream.feed(1).reasons == 0
    assert stream.following.trouble == ''
    motion = stream.feed(1, held).values
    assert float(np.abs(motion).max()) == pytest.approx(0.5, rel=0.4)  # a region's mean of it


def test_why_a_dented_rest_image_is_of_no_use_is_said_until_it_is_taken_anew() -> None:
    stream = Stream()
    stream.feed(6, press(180, 250, 0.5))
    stream.feed(6)
    assert 'something touched the gel when the rest image was captured' in stream.following.trouble
    stream.feed(16)
    assert stream.following.trouble == ''


def test_another_light_is_reported_and_then_has_a_rest_image_of_its_own_until_it_ends() -> None:
    stream = at_rest()
    assert stream.feed(1, light=0.5).reasons & FORCE.REASON_LIGHT_CHANGED
    assert stream.feed(20, light=0.5).reasons == 0
    assert len(stream.announced) == 2
    stream.feed(1)
    assert stream.feed(1).reasons == 0
    assert stream.announced[2] == stream.announced[0]


def test_a_blur_of_a_third_of_a_pixel_has_a_rest_image_of_its_own_until_it_ends() -> None:
    """A hundredth of the motion that is measured beside the sharp one; frames at rest look still beside it."""
    stream, touch = at_rest(4), press(200, 200, 1.0)
    stream.blur_px = 0.45
    assert stream.feed(1, touch).reasons & FORCE.REASON_BLURRED
    stream.feed(14)
    assert len(stream.announced) == 2
    message = stream.feed(1, touch)
    assert message.reasons & FORCE.REASON_BLURRED
    stream.blur_px = 0.0
    stream.feed(2, touch)
    assert stream.following.reference_id == stream.announced[0]
    assert stream.feed(1, touch).reasons == 0


def test_a_blur_that_comes_during_a_touch_counts_as_another_picture_until_it_has_a_rest_image() -> None:
    """Beside the sharp one a blur of 1 px leaves six tenths of the force; beside its own rest image all of it."""
    stream, touch = at_rest(), press(200, 200, 1.0)
    both = FORCE.REASON_LIGHT_CHANGED | FORCE.REASON_BLURRED
    stream.feed(2, touch)
    stream.blur_px = 0.6
    assert {stream.feed(1, touch).reasons & both for _ in range(6)} == {both}
    stream.feed(20)
    assert stream.feed(1, touch).reasons & both == FORCE.REASON_BLURRED


def test_a_picture_that_sharpens_during_a_touch_counts_as_another_one_and_noise_seen_at_rest_does_not() -> None:
    """A camera that still focused at the capture. Motion is then too large, by a third at 1 px."""
    both, touched = FORCE.REASON_BLURRED | FORCE.REASON_LIGHT_CHANGED, press(180, 250, 0.5)
    stream = Stream()
    stream.blur_px = 1.0
    stream.feed(8)
    stream.blur_px = 0.0
    assert stream.feed(1, touched).reasons & both == both
    noisy = at_rest()
    noisy.noise_grey = 5.0
    noisy.feed(4)
    assert noisy.feed(1, touched).reasons & both == FORCE.REASON_BLURRED


def test_a_blurred_picture_is_not_said_to_have_another_light() -> None:
    """The pattern that blur takes away comes back by focusing, and not by mending the lamp."""
    stream, touch = at_rest(), press(200, 200, 1.0)
    stream.blur_px = 1.3
    stream.feed(20)
    reasons = [stream.feed(1, touch).reasons for _ in range(6)] + [stream.feed(1).reasons for _ in range(6)]
    assert any(each & FORCE.REASON_BLURRED for each in reasons)
    assert not any(each & FORCE.REASON_LIGHT_CHANGED for each in reasons)


def test_bands_that_roll_over_the_picture_are_reported_while_they_last_and_make_no_rest_image() -> None:
    stream = at_rest()
    stream.bands_grey = 25.0
    assert {stream.feed(1).reasons & FORCE.REASON_LIGHT_CHANGED for _ in range(20)} == {FORCE.REASON_LIGHT_CHANGED}
    assert len(stream.announced) == 1
    stream.bands_grey = 0.0
    stream.feed(2)
    assert stream.feed(1).reasons == 0


def test_the_rest_image_is_not_renewed_while_something_presses() -> None:
    stream = at_rest()
    stream.feed(30, press(200, 230, 0.5), light=0.5)
    assert len(stream.announced) == 1


def test_a_knock_is_degraded_until_three_frames_have_shown_the_gel_at_rest() -> None:
    stream = at_rest()
    reasons = [stream.feed(1, shift(0.7, -0.4)).reasons for _ in range(6)]
    assert [bool(each & FORCE.REASON_FOREIGN_MOTION) for each in reasons] == [True, True, False, False, False, False]


def test_a_touch_that_comes_with_a_knock_and_stays_is_not_taken_for_what_the_knock_left() -> None:
    stream, knocked, touch = at_rest(), shift(2.1, -2.1), press(200, 230, 0.08)
    held = [stream.feed(1, touch, knocked) for _ in range(16)]
    assert all(each.reasons & FORCE.REASON_FOREIGN_MOTION for each in held)
    largest = [float(np.abs(each.values).max()) for each in held[1:]]
    assert min(largest) > 0.6 * max(largest)
    assert [stream.feed(1, knocked).reasons & FORCE.REASON_FOREIGN_MOTION for _ in range(5)][-1] == 0


@pytest.mark.parametrize('model', ['portable', 'fast'])  # which measure at full and at half size
def test_a_knock_by_parts_of_a_pixel_gets_a_rest_image_of_its_own(model: str) -> None:
    stream, knocked = Stream(model), shift(0.5, 0.5)
    stream.feed(8)
    stream.feed(15, knocked)
    assert len(stream.announced) == 2
    assert stream.feed(1, knocked).reasons == 0


def test_a_gel_seated_anew_whose_markers_moved_each_its_way_is_measured_as_before_once_it_rested() -> None:
    """Markers near the camera move otherwise than those above them, by a tenth of a pixel: patches are off by 0.02."""
    depths = np.random.default_rng(5).normal(0, 0.15, (len(DOTS), 2))
    stream, touch = at_rest(), press(200, 200, 1.0)
    before = stream.feed(1, touch)
    messages = [stream.feed(1, shift(0.8, -0.6), lambda _: depths) for _ in range(24)]
    assert [each.reasons for each in messages[-8:]] == [0] * 8
    assert all(each.untouched or np.abs(each.values).max() < 0.02 for each in messages[-8:])
    after = stream.feed(1, touch, shift(0.8, -0.6), lambda _: depths)
    assert after.reasons == 0
    assert np.sqrt(np.square(np.subtract(after.values, before.values)).mean()) < 0.01


@pytest.mark.parametrize(('model', 'percent'), [('fast', 0.2), ('paper', 1.0)])
def test_a_camera_that_magnifies_is_in_doubt_until_the_gel_was_seen_at_rest(model: str, percent: float) -> None:
    """A dense search needs a rest image of its own, the second of which comes after two seconds."""
    stream, larger = Stream(model=model), grow(percent / 100)
    stream.feed(8)
    assert stream.feed(1, larger).reasons & FORCE.REASON_FOREIGN_MOTION
    stream.feed(30, larger)
    assert stream.feed(2, press(200, 200, 1.0), larger).reasons == 0
    stream.every_ns = S // 10
    stream.feed(27)
    assert stream.feed(1).reasons == stream.feed(1, press(200, 200, 1.0)).reasons == 0


def test_a_picture_that_grew_while_each_marker_moved_its_way_stays_degraded_whatever_its_camera_does() -> None:
    """Those near the camera moved otherwise than those above them, so that patches are off by 0.04 px: another gel."""
    depths = np.random.default_rng(5).normal(0, 0.3, (len(DOTS), 2))
    stream, swollen = at_rest(), (grow(0.0015), lambda _: depths)  # by 0.33 px at the rim
    messages = [stream.feed(1, *swollen) for _ in range(20)]
    assert stream.following.renewed
    messages += [stream.feed(1, *swollen, grow(0.005)) for _ in range(20)]
    assert all(each.reasons & FORCE.REASON_FOREIGN_MOTION for each in messages)
    stream.feed(8)
    assert not stream.feed(1).reasons & FORCE.REASON_FOREIGN_MOTION


def test_a_speck_of_dirt_is_reported_until_it_is_gone() -> None:
    stream = at_rest()
    stream.spot = np.s_[300:320, 300:320]
    assert stream.feed(4).reasons & FORCE.REASON_LIGHT_CHANGED
    stream.spot = None
    assert stream.feed(4).reasons == 0


@pytest.mark.parametrize('noisy', [False, True])
def test_a_picture_that_a_noisy_camera_repeats_is_stale(noisy: bool) -> None:
    """A camera or its server may hang and send its last picture with new stamps. Pictures without noise may be equal,
    as those of a simulator are."""
    following, reasons = Following(FollowingParams(reference_frames=4)), []
    following.begin_capture()
    for number in range(13):
        head = conversions.header(S + number * S // 30, 'camera')
        image = picture(number=min(number, 5) if noisy else 0)
        reasons.append(following.answer(image, head, acquire_s=0.0, waited_s=0.001).reasons)
    assert [bool(each & FORCE.REASON_STALE) for each in reasons] == [False] * 12 + [noisy]


def test_an_old_frame_is_reported() -> None:
    stream = at_rest()
    assert stream.feed(1, age_s=0.3).reasons == FORCE.REASON_STALE


@pytest.mark.parametrize(('grey', 'reason'), [(0, FORCE.REASON_DARK_IMAGE), (255, FORCE.REASON_SATURATED_IMAGE)])
def test_black_and_white_are_reported_in_the_first_frame_and_forgotten_in_the_next(grey: int, reason: int) -> None:
    stream = at_rest()
    nothing = np.full((440, 440), grey, np.uint8)
    assert stream.following.answer(nothing, conversions.header(2 * S, '')).reasons == reason
    stream.at_ns = 3 * S
    assert stream.feed(1).reasons == 0


def test_less_than_a_seventh_of_the_light_is_dark_at_once_and_forgotten_when_it_is_back() -> None:
    stream = at_rest()
    assert not stream.feed(1, light=0.2).reasons & FORCE.REASON_DARK_IMAGE
    assert stream.feed(1, light=0.12).reasons == FORCE.REASON_DARK_IMAGE
    assert stream.feed(1).reasons == 0


@pytest.fixture(scope='module')
def fast() -> Estimating:
    return Estimating('fast')


NONE = st.sampled_from([np.nan, np.inf, -np.inf])


@given(st.dictionaries(st.integers(0, 199), NONE, min_size=1, max_size=4))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_status_is_never_ok_of_features_that_are_none(fast: Estimating, none: dict[int, float]) -> None:
    values = np.zeros(200, np.float32)
    values[list(none)] = list(none.values())
    message = types.FlowFeatures(
        header=conversions.header(S, ''), rows=10, cols=10, channels=2, encoding='cartesian_mean', values=values,
        confidence=np.ones(100, np.float32), image_width=440, image_height=440,
    )  # fmt: skip
    force = fast.answer(message, '', 0.85, 0.0)
    assert force.status == FORCE.STATUS_INVALID
    assert not force.in_contact
    wrench = conversions.wrench_message(force).wrench
    assert np.isnan([wrench.force.z, wrench.torque.x, wrench.torque.y]).all()
