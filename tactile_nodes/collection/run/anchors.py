"""Anchor presses (reference presses): one place, pressed repeatedly, whose image and force must stay the same.

The machine counts its steps without feedback. An axis that sticks or loses steps moves the presses without notice, but
the gel shows it. At the start of a run the anchor is pressed, then half a millimetre to the right, half a millimetre to
the back, and once more. This gives the image motion for each axis (a stuck axis does not move the image), and the
noise. From then on, an anchor that is displaced from the first one means that the position is lost.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tactile_nodes.collection.actions import Procedure
from tactile_nodes.collection.plan.journal import NO_PRESS
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.cycle import Ground, Record, press_cycle
from tactile_nodes.collection.readings import Picture, frame_of
from tactile_nodes.collection.settings import AnchorSettings, CollectionSettings
from tactile_nodes.errors import DeviceFaultError, ImageError
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.rest.reference import average

FRAMES = 5
WIDEST_VIEW_MM = 100.0  # upper bound of the visible width: 1 mm of tip motion is at least 1/100 of the image's side
SKEWED = 0.4  # an axis is stuck if it moves the image by less than this fraction of the other axis
HERTZ = 2 / 3
AXES = 'xy'


class Shift(NamedTuple):
    """Displacement of a press from where it should be: x and y by the image, z (up) by the force, in mm."""

    x_mm: float
    y_mm: float
    z_mm: float

    @property
    def farthest_mm(self) -> float:
        return max(map(abs, self))

    def describe(self) -> str:
        """'x +0.52, y -0.01, z +0.02 mm'"""
        return f'x {self.x_mm:+.2f}, y {self.y_mm:+.2f}, z {self.z_mm:+.2f} mm'


class Anchors:
    """The anchor of a run.

    Args:
        settings: its place, and the largest allowed displacement.
        press: makes a press, with images.
    """

    def __init__(self, settings: AnchorSettings, press: Callable[[Point], Record]) -> None:
        self._settings = settings
        self._press = press
        self._first: Record | None = None
        self._mm_from_px: npt.NDArray[Any] = np.zeros((2, 2))

    def begin(self) -> Shift:
        """Press the anchor, beside it, and again; returns the displacement of the second from the first.

        Raises:
            DeviceFaultError: it cannot be pressed, the image does not follow an axis, or the same place gives another
                image.
        """
        step = self._settings.step_mm
        first = self._first = self._press_anchor(0.0, 0.0)
        moved = [shift_px(_imprint(first), _imprint(self._press_anchor(*way))) for way in ((step, 0.0), (0.0, step))]
        self._mm_from_px = np.linalg.inv(follows(np.array(moved).T / step, step, min(first.frames[0].image.shape)))
        shift = self.look()
        if self.is_beside(shift):
            raise DeviceFaultError(
                f'two presses at the same place were {shift.describe()} apart; does an axis stick or lose steps, '
                'is the tip loose, does the gel slip?'
            )
        return shift

    def look(self) -> Shift:
        """Press the anchor; returns its displacement from the first.

        Raises:
            DeviceFaultError: it cannot be pressed.
        """
        assert self._first is not None
        return self.between(self._first, self._press_anchor(0.0, 0.0))

    def between(self, earlier: Record, later: Record) -> Shift:
        """Displacement of a press from an earlier one with the same place and depth."""
        x_mm, y_mm = self._mm_from_px @ shift_px(_imprint(earlier), _imprint(later))
        return Shift(float(x_mm), float(y_mm), _deeper_mm(earlier, later))

    def is_beside(self, shift: Shift) -> bool:
        """Whether a displacement is too large, or not a number."""
        return not shift.farthest_mm <= self._settings.shift_mm

    def _press_anchor(self, x_mm: float, y_mm: float) -> Record:
        s = self._settings
        record = self._press(Point(NO_PRESS, s.x_mm + x_mm, s.y_mm + y_mm, s.depth_mm))
        if record.reason:
            raise DeviceFaultError(
                f'the anchor at x {record.point.x_mm:g}, y {record.point.y_mm:g} mm could not be pressed, because '
                f'{record.reason}; does an axis stick or lose steps?'
            )
        return record


def anchor_press(point: Point, ground: Ground, settings: CollectionSettings) -> Procedure[Record]:
    """A press like any other, repeated until one can be used, or `limits.attempts` times; returns the last."""
    record = Record(point, 0)
    frames = max(FRAMES, settings.press.frames)
    patient = dataclasses.replace(settings.press, rest_frames=FRAMES, frames=frames)
    for attempt in range(1, settings.limits.attempts + 1):
        record = Record(point, attempt)
        yield from press_cycle(record, ground, dataclasses.replace(settings, press=patient))
        if not record.reason:
            break
    return record


def follows(px_per_mm: npt.NDArray[Any], step_mm: float, side_px: int) -> npt.NDArray[Any]:
    """How the image moves with the axes, columns x and y, if it does.

    Raises:
        DeviceFaultError: it does not follow one of them.
    """
    lengths = np.hypot(*px_per_mm)
    least = max(side_px / WIDEST_VIEW_MM, SKEWED * float(lengths.max()))
    if lengths.min() < least:
        axis = int(lengths.argmin())
        raise DeviceFaultError(
            f'the image does not follow the {AXES[axis]} axis: it moved by {lengths[axis] * step_mm:.2f} pixels for '
            f'{step_mm:g} mm, less than {least * step_mm:.2f}; the axis sticks, or the camera does not see the gel'
        )
    if abs(np.linalg.det(px_per_mm)) < SKEWED * lengths.prod():
        raise DeviceFaultError('the image moves in the same direction with both axes; are the axes coupled?')
    return px_per_mm


def _imprint(record: Record) -> Imprint:
    return imprint(average([frame.image for frame in record.rest]), average([frame.image for frame in record.frames]))


def _deeper_mm(earlier: Record, later: Record) -> float:
    """How much higher the later press was. By Hertz, F^(2/3) is proportional to depth. 0 if either has no force z."""
    before, after = -earlier.wrench[2], -later.wrench[2]
    if math.isnan(before) or math.isnan(after):
        return 0.0
    return earlier.point.depth_mm * float(1 - (max(after, 0.0) / before) ** HERTZ)


Field = npt.NDArray[np.float32]
NEAR = 1 / 7  # of the image's side: radius around the press in which motion counts
SMOOTH = 1 / 55
NOISE = 3.0  # changes below this many medians of all blocks are noise


@dataclass(frozen=True)
class Imprint:
    """Effect of a press on the image: displacement (h, w, 2) in pixels, smoothed, and its centre (x, y) in pixels."""

    field_px: Field
    middle_px: tuple[float, float]


def imprint(rest: Picture, pressed: Picture) -> Imprint:
    """From images of the gel untouched and pressed.

    Raises:
        ImageError: they differ in size, or are not grey images of at least 32x32 pixels.
    """
    flow = make_flow('dis')
    flow.set_reference(rest)
    field = flow.displacement(pressed).displacement_px
    smoothed = cv2.GaussianBlur(field, (0, 0), min(rest.shape) * SMOOTH)
    return Imprint(np.asarray(smoothed, np.float32), _middle_px(rest, pressed))


def shift_px(first: Imprint, second: Imprint) -> tuple[float, float]:
    """Displacement of the second press from the first, right and down; (0, 0) if either field is zero.

    A tip that is displaced by s moves the field of displacements u that it makes: u' - u = -s·∇u + c·u. So s follows by
    least squares, without a model of gel or camera. On the simulated gel at 1 mm depth, s has a scatter of 0.02 mm and
    is right to a tenth up to 1 mm; beyond 2 mm it only means "far".

    A field that is the first one moved by 1 pixel to the right gives (1, 0).

    Raises:
        ImageError: their images differ in size.
    """
    u, v = first.field_px, second.field_px
    if u.shape != v.shape:
        raise ImageError('the image size has changed; do not change camera settings during a run')
    rows, columns = np.mgrid[: u.shape[0], : u.shape[1]]
    x, y = first.middle_px
    near = np.hypot(columns - x, rows - y) < min(u.shape[:2]) * NEAR
    right, down = np.gradient(u, axis=1), np.gradient(u, axis=0)
    terms = np.stack([-right[near].ravel(), -down[near].ravel(), u[near].ravel()], axis=1)
    (dx, dy, _), *_ = np.linalg.lstsq(terms, (v - u)[near].ravel(), rcond=None)
    return float(dx), float(dy)


def _middle_px(rest: Picture, pressed: Picture) -> tuple[float, float]:
    """Centre of the change; centre of the image if nothing changed."""
    blocks = np.abs(frame_of(0, pressed).blocks - frame_of(0, rest).blocks)
    weights = np.maximum(blocks - NOISE * np.median(blocks), 0.0)
    if not weights.sum() > 0:
        return (rest.shape[1] - 1) / 2, (rest.shape[0] - 1) / 2
    side = rest.shape[0] // blocks.shape[0]
    rows, columns = np.mgrid[: blocks.shape[0], : blocks.shape[1]] * side + (side - 1) / 2
    return float((weights * columns).sum() / weights.sum()), float((weights * rows).sum() / weights.sum())
