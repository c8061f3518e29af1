"""Presses of a camera that has moved since the rest image, by an image of the untouched gel from right before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coarse_table import linear_table

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.features import Features, as_motion, make_encoding
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.rest.moved_camera import MovedCamera, common_motion
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

GEL = replace(Gel(), mechanics='linear')
PRESS = (Press(2.0, -3.0, 0.5),)
PX_PER_MM = 290 / 20
"""In the middle of the image: 290 px per radian, and markers 17 to 23 mm from the pupil."""


def taken(number: int, presses: tuple[Press, ...] = (), *, moved_mm: float = 0.0, seed: int = 0) -> np.ndarray:
    """An image by a camera that has moved, of the gel of that seed."""
    gel = replace(GEL, camera_shift_mm=(moved_mm, 0.0), seed=seed)
    return np.ascontiguousarray(centre_crop(Optics(gel, linear_table(gel)).render(presses, number), 440, 440))


@pytest.fixture(scope='module', params=['inverse_compositional', 'dis'])
def rest(request: pytest.FixtureRequest) -> PreparedRest:
    encoding = make_encoding('polar_mean' if request.param == 'dis' else 'cartesian_mean', {'rows': 20, 'cols': 20})
    flow = make_flow(request.param, {} if request.param == 'dis' else {'rows': 20, 'cols': 20})
    return Measuring(flow, encoding, registers=True).beside(average([taken(each) for each in range(8)]))


def motion_of(found: Features) -> np.ndarray:
    return as_motion(found.encoding, np.where(found.confidence[..., None] > 0.5, found.values, 0.0))


@pytest.mark.parametrize('moved_mm', [0.003, 0.05])
def test_a_press_shows_the_same_motion_after_the_camera_has_moved(rest: PreparedRest, moved_mm: float) -> None:
    still = motion_of(rest.features(taken(20, PRESS)))
    pressed = taken(20, PRESS, moved_mm=moved_mm)
    off = motion_of(MovedCamera(rest, taken(30, moved_mm=moved_mm)).features(pressed)) - still
    raw = motion_of(rest.features(pressed)) - still
    assert np.abs(raw).max() > 0.9 * PX_PER_MM * moved_mm
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.15 * np.abs(raw.mean(axis=(0, 1))).max()


def test_a_camera_that_gives_way_under_the_force_moves_no_press(rest: PreparedRest) -> None:
    """By 0.02 mm, 0.3 px: live sensing takes that for a knock, so no model may learn it as an effect of the force."""
    still, pressed = motion_of(rest.features(taken(20, PRESS))), taken(20, PRESS, moved_mm=0.02)
    camera = MovedCamera(rest)
    off, raw = (motion_of(camera.features(pressed, pressed=each)) - still for each in (True, False))
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.15 * np.abs(raw.mean(axis=(0, 1))).max()
    assert np.abs(raw).max() > 0.9 * PX_PER_MM * 0.02


def test_a_shift_is_found_in_pixels(rest: PreparedRest) -> None:
    motion, size_px = common_motion(rest, rest.features(taken(31, moved_mm=0.05)))
    assert motion.shift_px == pytest.approx((-0.05 * PX_PER_MM, 0.0), abs=0.06)
    assert 0.7 * 0.05 * PX_PER_MM < size_px < 0.05 * PX_PER_MM


def test_an_image_of_another_gel_is_refused(rest: PreparedRest) -> None:
    if rest.flow.name == 'dis':
        pytest.skip('a dense search finds some motion in any image')
    with pytest.raises(ImageError, match='does not show the pattern of the rest image; was the camera knocked'):
        MovedCamera(rest, taken(40, seed=77)).features(taken(41, seed=77))
