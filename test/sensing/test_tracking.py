"""The rest image: taken when told, from pictures that show something, and kept until a better one is there."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.overlay import overlay
from tactile_nodes.sensing.picture.stillness import StillnessCheck, StillnessOptions
from tactile_nodes.sensing.tracking import FeatureTracker

RNG = np.random.default_rng(5)
PATTERN = np.repeat(np.repeat(RNG.integers(0, 200, (40, 40), dtype=np.uint8), 4, 0), 4, 1)


def tracker(**options: object) -> FeatureTracker:
    flow, encoding = make_flow('dis'), make_encoding('cartesian_mean', {'rows': 10, 'cols': 10})
    return FeatureTracker(flow, encoding, **options)  # type: ignore[arg-type]


def test_rest_image_is_the_mean_of_as_many_frames_as_asked() -> None:
    found = tracker(rest_frames=2)
    found.begin_capture()
    assert not found.offer_rest(PATTERN)
    assert found.offer_rest(PATTERN + 2)
    assert found.reference is not None
    assert (found.reference == PATTERN + 1).all()
    assert not found.capturing


def test_a_capture_begins_anew_with_a_frame_that_shows_something_else() -> None:
    found = tracker(rest_frames=2)
    found.begin_capture()
    assert not found.offer_rest(np.roll(PATTERN, 1, axis=1))  # as when a touch ends
    assert not found.offer_rest(PATTERN)
    assert found.offer_rest(PATTERN)
    assert (found.reference == PATTERN).all()
    assert not found.unsteady


def test_of_a_picture_that_never_rests_any_frames_are_taken_and_that_is_told() -> None:
    found = tracker(rest_frames=2)
    found.begin_capture()
    done = [found.offer_rest(np.roll(PATTERN, number % 2, axis=1)) for number in range(9)]
    assert done.index(True) == 8  # four times two frames, and one
    assert found.unsteady


def test_frames_to_skip_are_left_out_whatever_they_show() -> None:
    found = tracker(rest_frames=1)
    found.begin_capture(skip=2)
    black = np.zeros_like(PATTERN)
    assert not found.offer_rest(black)
    assert not found.offer_rest(black)
    assert found.offer_rest(PATTERN)


def test_black_frames_do_not_go_into_a_rest_image() -> None:
    found = tracker(rest_frames=2)
    found.begin_capture()
    found.offer_rest(PATTERN)
    with pytest.raises(ImageError, match='black'):
        found.offer_rest(np.zeros_like(PATTERN))
    assert found.offer_rest(PATTERN)
    assert (found.reference == PATTERN).all()


def test_blank_rest_image_is_refused_and_the_one_before_stays() -> None:
    found = tracker(rest_frames=1)
    found.use_reference(PATTERN)
    kept = found.reference_id
    found.begin_capture()
    with pytest.raises(ImageError, match='markers'):
        found.offer_rest(np.full_like(PATTERN, 90))
    assert found.reference_id == kept
    assert found.capturing


def test_rest_images_of_other_content_have_other_ids() -> None:
    found = tracker()
    found.use_reference(PATTERN)
    first = found.reference_id
    found.use_reference(PATTERN[::-1].copy())
    assert found.reference_id != first
    assert len(first) == 12


def test_the_rest_image_itself_has_not_moved() -> None:
    found = tracker()
    found.use_reference(PATTERN)
    features = found.features(found.field(PATTERN))
    assert np.abs(features.values).max() < 1e-3


def test_without_a_rest_image_there_is_no_field() -> None:
    with pytest.raises(ImageError, match='no rest image yet'):
        tracker().field(PATTERN)


def test_overlay_draws_arrows_only_where_something_moves() -> None:
    field = np.zeros((160, 160, 2), np.float32)
    field[80:, 80:] = (3.0, 0.0)
    picture = overlay(np.zeros((160, 160), np.uint8), field)
    assert picture.shape == (160, 160, 3)
    assert picture[:70, :70].max() == 0
    assert picture[90:150, 90:150].max() > 0


def test_overlay_draws_motion_by_patches_where_the_patches_are() -> None:
    field = np.zeros((4, 4, 2), np.float32)
    field[2:, 2:] = (3.0, 0.0)
    picture = overlay(np.zeros((160, 160), np.uint8), field)
    assert picture[:70, :70].max() == 0
    assert picture[90:150, 90:150].max() > 0


def test_a_frame_in_which_nothing_touches_has_no_motion_and_is_not_measured() -> None:
    flow = make_flow('inverse_compositional', {'rows': 10, 'cols': 10})
    encoding = make_encoding('cartesian_mean', {'rows': 10, 'cols': 10})
    found = FeatureTracker(flow, encoding, check=StillnessCheck(StillnessOptions(full_every=1000)))
    found.use_reference(PATTERN)
    field = found.field(PATTERN)
    features = found.features(field)
    assert found.untouched(field)
    assert not features.values.any()
    assert features.confidence.min() > 0.9


def test_what_the_check_saw_of_a_frame_is_not_looked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    found = tracker(check=StillnessCheck(StillnessOptions(full_every=1000)))
    found.use_reference(PATTERN)
    found.field(PATTERN)
    seen = found.stillness(found.straight)
    monkeypatch.setattr(StillnessCheck, 'look', None)
    assert found.still and seen is not None and seen.motion < 1.0
    assert found.stillness(found.straight) is seen


def test_a_frame_that_moved_is_measured_as_without_the_check() -> None:
    checked, plain = tracker(check=StillnessCheck()), tracker()
    moved = np.roll(PATTERN, 2, axis=1)
    for each in (checked, plain):
        each.use_reference(PATTERN)
    field = checked.field(moved)
    assert not checked.untouched(field)
    assert (field.displacement_px == plain.field(moved).displacement_px).all()
