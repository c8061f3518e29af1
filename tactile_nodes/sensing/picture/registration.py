"""Registration: tracks the motion of the whole picture since the rest image, and removes it from measured motion.

It is estimated from the patches of the flow itself. While nothing touches, their common motion is followed slowly. A
press hardly moves patches far from it, so most patches never move alike under a press. If they do, by more than any
press causes, the camera was knocked, and the motion is removed at once. `docs/stability.md` has the measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tactile_nodes.sensing.features import fewer_means
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.dented_rest import DentedRest
from tactile_nodes.sensing.picture.knocks import KNOCK_PX, Common, whole_motion
from tactile_nodes.sensing.picture.motion import MotionFit, PictureMotion, Shift, Straightening
from tactile_nodes.sensing.picture.quietness import (
    KNOCKED_NOISE,
    PATCHES,
    TOUCHED_NOISE,
    loosely_quiet,
    median,
    noise_of,
    none_away,
    quiet,
)
from tactile_nodes.shapes import Bool, Float, UInt8

FOUND = 0.4
"""Least confidence of a patch that is found again."""

LEAST_SIDE_PX = 160
"""Side of the smallest picture on which separate patches are used."""

FEW_FOUND = 0.95
"""Below this share of the patches known at rest, a part of the picture is lost. Presses to 2 mm leave 0.98."""

LEAST_FOUND = 0.3
"""Share of the known patches that must be found for their common motion to be valid."""

LEAST_KNOWN = 0.15
"""Share of the patches that must show a pattern in the rest image for the motion of the whole picture to be known."""

NEGLIGIBLE_PX = 0.004
"""Smaller motion is not removed, as it is the noise of the rest image."""

SUBTRACTED_PX, SHIFTED_PX = 0.03, 0.1
"""Largest motion that is only subtracted from the measured flow, alone and after a shift of the image.

Models depend on the position of their regions to a fraction of a pixel: other pixels of a region show the same motion
with a difference of up to a hundredth. So a shift is first undone in the image (1 ms at 440x440). If more remains, as
after a turn, the whole motion is undone (8 ms).
"""

SETTLE_FRAMES = 8
"""Frames at rest over which the motion of a knock is averaged before it is followed slowly."""

EVEN_PX = 0.02
"""Growth of a picture is due to the camera if it leaves patch residuals below this (standard deviation).

A magnification by 0.2 to 2 % leaves 0.002 px, a camera 0.03 mm nearer 0.015. A gel that swells moves markers more the
higher they are in it: 0.1 mm changes the rim by 0.3 px and leaves 0.09.
"""

SURE_FRAMES = 3
"""After so many frames at rest by the coarse check, the first frame surely at rest settles a knock."""

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class RegistrationOptions:
    """Largest motion of the picture (root mean square, px; turn in degrees), and time constant of following (s)."""

    most_px: float = 8.0
    most_turn_deg: float = 2.5
    follow_s: float = 5.0


class Registered:
    """A rest image with all that is computed from it once.

    `own` is the flow measured in the rest image itself. If it has fewer patches or no confidence, separate patches are
    measured in every frame that is checked.
    """

    def __init__(self, image: UInt8[np.ndarray, 'h w'], own: DisplacementField, *, compiled: bool = False) -> None:
        self.image = image
        self.fit = MotionFit(image.shape, PATCHES, PATCHES, compiled=compiled)
        self.watch = None
        seen = np.ones(PATCHES**2, bool)
        if own.confidence is None or min(own.confidence.shape) < PATCHES:
            self.watch = _watch(image, compiled)
            seen = seen if own.confidence is None else believed(own.confidence)
            own = self.watch.displacement(image) if self.watch else own
        self.confidence = coarse(own)[1] if own.confidence is not None else np.zeros(PATCHES**2)
        self.known = (self.confidence >= FOUND) & seen
        self.known_count = int(self.known.sum())


class Registration:
    """Tracks the motion of the whole picture since the rest image, and removes it from images and measured motion.

    `settled`: the motion was confirmed with nothing on the gel since the last knock. `lost`: the picture is not found
    again, moved too far, or has another shape. `found` is the share of the known patches that were found again,
    `explained` how well the median one is, relative to the rest image. `surely`: nothing touched in the last frame;
    `maybe`: at most a light touch; `free`: less than 20 mN, by separate patches if the flow has none. The state follows
    only from the images and their stamps since the rest image. `dent` judges the rest image. `apart_px` is the motion
    of the picture since the rest image was captured.
    """

    DERIVED: ClassVar = ('_rest', '_reference', '_fit')

    def __init__(self, options: RegistrationOptions | None = None) -> None:
        self.options = options or RegistrationOptions()
        self.motion = self._base = self._resting = PictureMotion()
        self.settled, self.lost, self.found = True, False, 1.0
        self.surely, self.maybe, self.free = False, False, False
        self._moved_px, self.apart_px, self.explained, self._noise_px = 0.0, 0.0, 1.0, 0.0
        self._reference: np.ndarray | None = None
        self._rest: Registered
        self._fit: MotionFit
        self._straightening: Straightening | Shift | None = None
        self._remainder: PictureMotion | None = None
        self._offset: np.ndarray | None = None
        self._still = np.zeros((PATCHES * PATCHES, 2))
        self._magnified_px = self._grown_before_px = 0.0
        self.dent = DentedRest()

    @property
    def since_rest(self) -> PictureMotion:
        """The motion since the rest image in use, which is removed. `motion` is that since the first rest image."""
        return self.motion - self._base

    @property
    def size_px(self) -> float:
        """Root mean square, over the picture, of the motion that is removed."""
        return self._moved_px

    @property
    def watches(self) -> bool:
        """Whether separate patches are measured, because the flow has none."""
        return self._rest.watch is not None

    @property
    def grown_px(self) -> float:
        """Motion of the rim since the first rest image, out or in, without magnification by the camera."""
        return min(abs(self.motion.terms[2]), abs(self.motion.terms[2] - self._magnified_px))

    @property
    def straightening(self) -> Straightening | Shift | None:
        """The correction applied to images. A different one uses other pixels."""
        return self._straightening

    @property
    def beside_frame(self) -> PictureMotion:
        """Motion of straightened images relative to the first rest image."""
        return self.motion - self._straightening.motion if self._straightening else self.motion

    def set_reference(
        self, rest: Registered, offset: PictureMotion | None = None, motion: PictureMotion | None = None
    ) -> None:
        """Take a rest image. If made of straightened images, `offset` is its motion relative to the first rest image.

        The regions of a model then stay at their places in the first one, to within the subtracted motion. `motion` is
        that of the picture at the capture; smaller changes since then are noise, unless there was a knock.
        """
        self.look_beside(rest)
        self.lost, self.found = False, 1.0
        self._base = offset or PictureMotion()
        if offset is None:
            self.motion, self._straightening = PictureMotion(), None
            self._magnified_px = 0.0
        elif motion is not None and self._size_px(self.motion - motion) < KNOCK_PX:
            self.motion = motion
        self._grown_before_px = motion.terms[2] - self._magnified_px if motion and any(motion.terms) else 0.0
        self._resting = motion or self.motion
        self._take(self.motion, settled=True)
        self._rested = SETTLE_FRAMES
        self._forget_offset()
        self.dent = DentedRest()
        self._last_ns: int | None = None

    def look_beside(self, rest: Registered) -> None:
        """Take the data computed from the rest image, and keep all tracked motion."""
        self._rest, self._reference, self._fit = rest, rest.image, rest.fit

    def begin_anew(self) -> None:  # forget all motion since the rest image
        self.set_reference(self._rest, self._base, self._resting)

    def straightened(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image as if the camera had not moved, or the image itself if the motion is small enough."""
        if self._straightening is None or self._reference is None:
            return image
        return self._straightening(image, self._reference)

    def without(self, field: DisplacementField) -> DisplacementField:
        """Motion measured in a straightened image, without the remaining motion of the whole picture."""
        motion = field.displacement_px
        if self._remainder is not None and self._reference is not None:
            motion = motion - self._remainder.field_px(self._reference.shape, *motion.shape[:2])
        if self._offset is not None:
            motion = motion - self._offset
        return DisplacementField(motion, field.confidence)

    def at_rest(self, stamp_ns: int) -> None:
        """Record a frame in which nothing touches and nothing moved."""
        self._rested = max(self._rested, 1) + 1
        if not self.settled:  # a picture that is where it was moved as a whole
            self._magnified_px = self.motion.terms[2] - self._grown_before_px
        self.settled, self.lost, self.found, self._last_ns = True, False, 1.0, stamp_ns
        self.surely = self.maybe = self.free = True
        self.dent.rested(surely=True)

    def look(self, straight: UInt8[np.ndarray, 'h w'], field: DisplacementField, stamp_ns: int) -> bool:
        """Take the flow of a frame. Returns whether to measure the frame again, because the camera was knocked.

        Args:
            straight: the straightened image.
            field: motion in it without that of the whole picture.
            stamp_ns: stamp of the frame.
        """
        self.surely = self.maybe = self.free = False
        if self._rest.known_count < LEAST_KNOWN * PATCHES**2:
            return False  # a pattern too sparse to tell
        motion, found = self._patches(straight, field)
        self.found = int(np.count_nonzero(found)) / self._rest.known_count
        self.lost = self.found < LEAST_FOUND
        if self.lost:
            return False
        terms, common = whole_motion(self._fit, motion, found, self._noise_px)
        if common is not Common.NONE:
            return self._jump(terms) if common is Common.KNOCK else self._begin_anew()
        self._follow(motion, found, terms, field, stamp_ns)
        return False

    def _begin_anew(self) -> bool:
        """Mark the gel as misshapen and lost. If a correction was applied, drop it and measure again."""
        self.lost = True
        if self._straightening is None:
            return False
        self._straighten_anew(PictureMotion())
        return True

    def _jump(self, terms: Float[np.ndarray, ' terms']) -> bool:
        moved = self.motion + PictureMotion.of(terms)
        assert self._reference is not None
        turned = math.degrees(abs(moved.turn_rad(self._reference.shape))) > self.options.most_turn_deg
        if turned or self._size_px(moved) > self.options.most_px:
            self.lost = True
            return False
        self._straighten_anew(moved)
        return True

    def _straighten_anew(self, motion: PictureMotion) -> None:
        """Set the correction after a knock: this motion, or none if the camera is back in its place."""
        self._forget_offset()
        self._straightening = None
        self._take(motion, settled=False)
        self._rested = 0

    def _follow(
        self,
        motion: Float[np.ndarray, 'n 2'],
        found: np.ndarray,
        terms: Float[np.ndarray, ' terms'],
        field: DisplacementField,
        stamp_ns: int,
    ) -> None:
        """Follow the remaining motion of the whole picture while nothing touches, quickly after a knock."""
        left = motion - self._fit.carried(terms)
        early = self._rested < SETTLE_FRAMES
        beside = self.dent.without(left - self._still, found, settled=self.settled)
        knocked_px = 0.0 if self.settled else self.size_px  # the residual of a knock is known once it is settled
        self.maybe = loosely_quiet(beside, found, knocked_px, self.explained)
        if self.maybe:
            self._noise_px = noise_of(beside[found])
        self.surely = self.maybe and quiet(beside, found, compiled=self._fit.compiled)
        watched = self.watches and self.maybe
        self.free = self.surely or (watched and quiet(beside, found, TOUCHED_NOISE, compiled=self._fit.compiled))
        self.dent.rested(self.surely)
        learning = early and self.maybe and not self.settled
        learning = learning and none_away(beside, found, KNOCKED_NOISE, compiled=self._fit.compiled)
        if not (self.surely or learning):
            if self.maybe and not self.settled:  # something touched in those frames: restart
                self._rested = 0
                self._forget_offset()
            return
        self._rested += 1
        share = 1 / self._rested if early else self._share(stamp_ns)
        if early:
            self._take_offset(left, PictureMotion.of(terms), field)
        self._last_ns = stamp_ns
        self._take(
            self.motion + PictureMotion.of(terms).scaled(share),
            settled=self.settled or (self.surely and self._rested >= SURE_FRAMES),
        )
        if early and self.settled and noise_of(self._off(field)[found]) < EVEN_PX:
            self._magnified_px = self.motion.terms[2] - self._grown_before_px

    def _take_offset(self, left: Float[np.ndarray, 'n 2'], common: PictureMotion, field: DisplacementField) -> None:
        """Learn the offset of each patch after a corrected knock (other pixels): the mean of the first frames."""
        share = np.float32(1 / self._rested)
        if self._rest.watch is not None:  # dense search has offsets at rest too, which its models learned
            self._still += share * (left - self._still)
            return
        assert self._reference is not None
        rest = field.displacement_px - common.field_px(self._reference.shape, *field.displacement_px.shape[:2])
        self._offset = share * rest if self._offset is None else self._offset + share * rest

    def _off(self, field: DisplacementField) -> Float[np.ndarray, 'n 2']:
        """Offset of each patch after a corrected knock, as far as known."""
        if self._offset is None:
            return self._still
        return coarse(DisplacementField(self._offset, field.confidence))[0]

    def _forget_offset(self) -> None:
        self._offset = None
        self._still = np.zeros((PATCHES * PATCHES, 2))

    def _share(self, stamp_ns: int) -> float:
        """Gain of the filter that follows motion, from the time since the last frame at rest."""
        passed_s = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / NS_PER_S
        return 1 - math.exp(-min(max(passed_s, 0.0), 1.0) / self.options.follow_s)

    def _take(self, motion: PictureMotion, *, settled: bool) -> None:
        """Use this motion from now on. Images are straightened by it, or by one close enough."""
        assert self._reference is not None
        self.motion, self.settled = motion, settled
        if self._straightening is None or self._off_px(self._straightening) > NEGLIGIBLE_PX:
            self._straightening = self._straightening_for(motion)
        self._moved_px, self.apart_px = self._size_px(self.since_rest), self._size_px(motion - self._resting)
        left = self.beside_frame - self._base
        self._remainder = left if self._size_px(left) > NEGLIGIBLE_PX else None

    def _straightening_for(self, motion: PictureMotion) -> Straightening | Shift | None:
        if self._size_px(motion) <= SUBTRACTED_PX:
            return None
        shift = Shift(*motion.shift_px)
        if self._size_px(motion - shift.motion) <= SHIFTED_PX:
            return shift
        assert self._reference is not None
        return Straightening(motion, self._reference.shape)

    def _size_px(self, motion: PictureMotion) -> float:
        return self._fit.size_px(np.array(motion.terms))

    def _off_px(self, straightening: Straightening | Shift) -> float:
        """Error of a straightening. Shifts are accepted up to a limit."""
        near_px = SHIFTED_PX if isinstance(straightening, Shift) else 0.0
        return max(0.0, self._size_px(self.motion - straightening.motion) - near_px)

    def _patches(
        self, straight: UInt8[np.ndarray, 'h w'], field: DisplacementField
    ) -> tuple[Float[np.ndarray, 'patches 2'], Bool[np.ndarray, ' patches']]:
        """Motion of each patch, and which were found again."""
        if self._rest.watch is not None:
            field = self.without(self._rest.watch.displacement(straight))
        motion, confidence = coarse(field)
        found = (confidence >= FOUND) & self._rest.known
        self.explained = median(confidence[found] / self._rest.confidence[found]) if found.any() else 0.0
        return motion, found


def _watch(image: UInt8[np.ndarray, 'h w'], compiled: bool) -> InverseCompositionalFlow | None:
    """Separate patches at half size, or None if the picture is too small."""
    if min(image.shape) < LEAST_SIDE_PX:
        return None
    options = InverseCompositionalOptions(rows=PATCHES, cols=PATCHES, finest_scale=1)
    flow = InverseCompositionalFlow(options, compiled=compiled)
    flow.set_reference(image)
    return flow


def believed(confidence: Float[np.ndarray, 'rows cols']) -> Bool[np.ndarray, ' patches']:
    """Which of 10x10 patches lie where a method has confidence above 0. It has none where the gel is covered."""
    rows, cols = (np.arange(PATCHES) * count // PATCHES for count in confidence.shape)
    found: np.ndarray = (confidence > 0)[np.ix_(rows, cols)]
    return found.ravel()


def coarse(field: DisplacementField) -> tuple[Float[np.ndarray, 'patches 2'], Float[np.ndarray, ' patches']]:
    """Motion of 10x10 patches and its confidence."""
    assert field.confidence is not None
    motion, confidence = field.displacement_px, field.confidence
    if confidence.shape != (PATCHES, PATCHES):
        motion, confidence = fewer_means(motion, confidence, PATCHES, PATCHES)
    return motion.reshape(-1, 2).astype(float), confidence.reshape(-1).astype(float)
