"""A patch reads motion where its texture is; of another texture it is taken for what the first would have shown."""

from __future__ import annotations

import numpy as np
import pytest
from dots import SIDE, Motion, picture, press
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_nodes.sensing.features import make_encoding
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.registration import Registration
from tactile_nodes.sensing.rest.prepared import Measuring
from tactile_nodes.sensing.rest.texture_places import LEAST_PX, OtherTexture, other_texture, sloping
from tactile_nodes.sensing.tracking import FeatureTracker

PATCHES = 10


def flow_of(image: np.ndarray, patches: int = PATCHES) -> InverseCompositionalFlow:
    flow = InverseCompositionalFlow(InverseCompositionalOptions(rows=patches, cols=patches))
    flow.set_reference(image)
    return flow


FIRST, FEWER = picture(), picture(number=1, gone=0.3)
FULL, LEFT = flow_of(FIRST), flow_of(FEWER)
MIDDLES = (np.arange(PATCHES) + 0.5) * SIDE / PATCHES - SIDE / 2

part = st.floats(-1.0, 1.0)


@settings(max_examples=10, deadline=None)
@given(st.tuples(part, part, part, part).filter(lambda each: np.linalg.norm(each) > 0.1))
def test_what_a_patch_finds_of_slopes_of_motion_is_known_beforehand(direction: tuple[float, ...]) -> None:
    """Slopes of four thousandths in all, in any direction; noise is as large as what they make a patch be off by.

    So it is asked how much of what is told beforehand is there, of 64 patches within the picture and two axes: as a
    mean one, with a standard deviation of a tenth at most; four of those.
    """
    slopes = np.array(direction) / np.linalg.norm(direction) * 0.004
    a, b, c, d = slopes.tolist()
    x, y = np.meshgrid(MIDDLES, MIDDLES)
    middle = np.stack([a * x + b * y, c * x + d * y], axis=-1)
    frame = picture(lambda at: (at - SIDE / 2) @ np.array([[a, c], [b, d]]), number=2, gone=0.3)
    seen, told = LEFT.displacement(frame).displacement_px - middle, LEFT.answers @ slopes.astype(np.float32)
    inner = slice(1, -1)
    seen, told = seen[inner, inner], told[inner, inner]
    assert float((seen * told).sum() / np.square(told).sum()) == pytest.approx(1.0, abs=0.4)


def pushed(x_px: float, y_px: float) -> Motion:
    """Outwards from a place by 4 px at most, 60 px from it: as much and as wide as a press on a gel."""

    def away(at: np.ndarray) -> np.ndarray:
        apart = (at - [x_px, y_px]) / 60
        return 4 * apart * np.exp(0.5 - 0.5 * np.square(apart).sum(axis=1, keepdims=True))

    return away


def test_motion_among_fewer_dots_is_what_all_would_have_shown() -> None:
    """A third of the mean square by which patches beside a press are off is of the first order."""
    full, left = flow_of(FIRST, 20), flow_of(FEWER, 20)
    other, off, plain = other_texture(left, full, FIRST.shape), [], []
    assert other is not None
    for x, y in ((150, 150), (220, 240), (300, 180)):
        expected = full.displacement(picture(pushed(x, y), number=3)).displacement_px
        seen = left.displacement(picture(pushed(x, y), number=3, gone=0.3))
        plain.append(seen.displacement_px - expected)
        off.append(other.as_first(seen).displacement_px - expected)
    assert np.square(off).mean() < 0.75 * np.square(plain).mean()


def test_steep_motion_among_fewer_dots_is_hardly_touched() -> None:
    """Within 26 px of a press the first order of patches 44 px wide means nothing: alone it makes twice of it."""
    other, off, plain = other_texture(LEFT, FULL, FIRST.shape), [], []
    assert other is not None
    for x, y in ((150, 150), (220, 240), (300, 180)):
        expected = FULL.displacement(picture(press(x, y, 4.0), number=3)).displacement_px
        seen = LEFT.displacement(picture(press(x, y, 4.0), number=3, gone=0.3))
        plain.append(seen.displacement_px - expected)
        off.append(other.as_first(seen).displacement_px - expected)
    assert np.square(off).mean() < 1.2 * np.square(plain).mean()


def test_two_rest_images_of_one_texture_do_not_differ() -> None:
    again = flow_of(picture(number=4))
    assert other_texture(again, FULL, FIRST.shape) is None
    apart = OtherTexture(again.answers, FULL.answers, np.minimum(again.known, FULL.known), FIRST.shape)
    assert 0 < apart.apart_px < LEAST_PX


def test_patches_that_are_not_known_change_nothing() -> None:
    nothing = OtherTexture(LEFT.answers, FULL.answers, np.zeros((PATCHES, PATCHES), np.float32), FIRST.shape)
    seen = LEFT.displacement(picture(press(200, 200, 3.0), gone=0.3))
    assert not nothing.differs
    assert (nothing.as_first(seen).displacement_px == seen.displacement_px).all()


@pytest.mark.parametrize('axis', [0, 1])
def test_slopes_of_a_polynomial_of_the_third_degree_are_exact_but_at_the_rim(axis: int) -> None:
    along = np.arange(8.0)
    values = np.moveaxis(np.broadcast_to(along[:, None, None] ** 3, (8, 8, 2)), 0, axis)
    found = np.moveaxis(sloping(values.astype(np.float32), axis), axis, 0)
    assert found[2:-2] == pytest.approx(np.broadcast_to((3 * along**2)[2:-2, None, None], found[2:-2].shape), rel=1e-5)


def test_a_tracker_takes_motion_beside_a_renewed_rest_image_for_that_beside_the_first() -> None:
    encoding = make_encoding('cartesian_mean', {'rows': PATCHES, 'cols': PATCHES})
    tracker = FeatureTracker(flow_of(FIRST), encoding, registration=Registration())
    tracker.use_reference(FIRST)
    first = tracker.rest
    tracker.use(tracker.prepared(FEWER), offset=PictureMotion(), motion=PictureMotion())
    frame = picture(press(220, 240, 4.0), number=3, gone=0.3)
    other = other_texture(LEFT, FULL, FIRST.shape)
    assert other is not None and first is not None
    expected = other.as_first(LEFT.displacement(frame)).displacement_px
    assert tracker.field(frame, 1).displacement_px == pytest.approx(expected, abs=1e-4)
    tracker.use(first, offset=PictureMotion(), motion=PictureMotion())
    assert tracker.field(picture(press(220, 240, 4.0)), 2).displacement_px == pytest.approx(
        FULL.displacement(picture(press(220, 240, 4.0))).displacement_px, abs=1e-4
    )


def test_beside_a_renewed_rest_image_that_asks_for_it_motion_is_measured_by_the_finer_way() -> None:
    """And taken for what the finer way would have found beside the first rest image."""
    fine = make_encoding('cartesian_mean', {'rows': 2 * PATCHES, 'cols': 2 * PATCHES})
    finer = Measuring(fine_flow(), fine)
    encoding = make_encoding('cartesian_mean', {'rows': PATCHES, 'cols': PATCHES})
    tracker = FeatureTracker(flow_of(FIRST), encoding, registration=Registration(), finer=finer)
    tracker.use_reference(FIRST)
    asked = tracker.prepared(FEWER, renewed=True, finer=True)
    tracker.use(asked, offset=PictureMotion(), motion=PictureMotion())
    frame = picture(press(220, 240, 4.0), number=3, gone=0.3)
    now, first = fine_flow(), fine_flow()
    now.set_reference(FEWER)
    first.set_reference(FIRST)
    other = other_texture(now, first, FIRST.shape)
    assert other is not None
    field = tracker.field(frame, 1)
    assert field.displacement_px == pytest.approx(other.as_first(now.displacement(frame)).displacement_px, abs=1e-4)
    assert tracker.features(field).values.shape == (2 * PATCHES, 2 * PATCHES, 2)
    tracker.use(tracker.prepared(FEWER, renewed=True), offset=PictureMotion(), motion=PictureMotion())
    assert tracker.field(frame, 2).displacement_px.shape == (PATCHES, PATCHES, 2)


def fine_flow() -> InverseCompositionalFlow:
    return InverseCompositionalFlow(InverseCompositionalOptions(rows=2 * PATCHES, cols=2 * PATCHES))
