"""A knocked camera is no force: the motion of the whole picture since the rest image is kept, and taken out.

It is found from the patches of the flow itself. While nothing touches, whatever they move by together is followed,
slowly. A press moves no patch far from it, so most patches never move alike under one; where they do, by more than any
press makes them, the camera was knocked, and that is taken out at once. `docs/stability.md` has the measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float, UInt8

from tactile_nodes.sensing.features import fewer_means
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow, InverseCompositionalOptions
from tactile_nodes.sensing.flow.methods import DisplacementField
from tactile_nodes.sensing.picture.dented_rest import DentedRest
from tactile_nodes.sensing.picture.knocks import KNOCK_PX, Common, judge
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

FOUND = 0.4
"""Confidence from which a patch counts as found again."""

LEAST_SIDE_PX = 160
"""Side of the smallest picture that patches of our own are laid over."""

FEW_FOUND = 0.95
"""Share of the patches known at rest below which a part of the picture is lost: presses to 2 mm leave 0.98."""

LEAST_FOUND = 0.3
"""Share of the patches that must be found before their common motion means anything."""

NEGLIGIBLE_PX = 0.004
"""Smaller motion is not taken out: it is the noise of the rest image."""

SUBTRACTED_PX, SHIFTED_PX = 0.03, 0.1
"""Motion up to which it is subtracted from what the flow finds, alone and beside a shift of the image.

Models know their regions to a fraction of a pixel: what other pixels of a region show of the same motion differs by up
to a hundredth. So a shift is undone in the image before, which takes 1 ms for an image of 440x440, and where that
leaves more, as of a turn, all of the motion, which takes 8 ms.
"""

SETTLE_FRAMES = 8
"""Frames at rest that a knock's motion is averaged over before it is only followed slowly."""

EVEN_PX = 0.02
"""A picture beside whose growth patches are off by less than this (standard deviation) was magnified by its camera.

Magnified by 0.2 to 2 % it leaves 0.002 px, of a camera 0.03 mm nearer 0.015. A gel that swells moves markers more the
higher they lie in it: by 0.1 mm it changes the rim by 0.3 px and leaves 0.09.
"""

SURE_FRAMES = 3
"""Frames at rest, as far as a coarse look tells, after which the first that is surely at rest settles a knock."""

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class RegistrationOptions:
    """How far the picture may have moved (root mean square, px; turn in degrees), and how slowly it is followed (s)."""

    most_px: float = 8.0
    most_turn_deg: float = 2.5
    follow_s: float = 5.0


class Registered:
    """A rest image with what is computed of it once.

    `own` is what the flow finds in the rest image itself. Where it has fewer patches or does not say how sure it is,
    patches of our own are measured in every frame that is looked at.
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
    """Keeps the motion of the whole picture since the rest image, and takes it out of images and of motion found.

    `settled`: the motion was confirmed with nothing on the gel since the last knock. `lost`: the picture is not found
    again, moved too far, or has another shape. `found` is the share of the known patches that were found again,
    `explained` how well the middle one is, beside the rest image itself. `surely`: nothing touched in the last frame;
    `maybe`: not much did; `free`: less than 20 mN, as patches beside a flow without any tell. All follows from the
    images and their stamps since the rest image; `dent` is what they say of that. `apart_px` is how far the picture has
    moved since the rest image was taken.
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
        """The motion since the rest image in use, which is taken out; `motion` is that since the first one."""
        return self.motion - self._base

    @property
    def size_px(self) -> float:
        """Of the motion that is taken out: root mean square over the picture."""
        return self._moved_px

    @property
    def watches(self) -> bool:
        """Whether patches of our own are measured beside a flow that has none."""
        return self._rest.watch is not None

    @property
    def grown_px(self) -> float:
        """By how much the rim moved since the first rest image, out or in, but for what its camera magnified."""
        return min(abs(self.motion.terms[2]), abs(self.motion.terms[2] - self._magnified_px))

    @property
    def straightening(self) -> Straightening | Shift | None:
        """What straightens images; another one falls on other pixels."""
        return self._straightening

    @property
    def beside_frame(self) -> PictureMotion:
        """Where straightened images lie beside the first rest image."""
        return self.motion - self._straightening.motion if self._straightening else self.motion

    def set_reference(
        self, rest: Registered, offset: PictureMotion | None = None, motion: PictureMotion | None = None
    ) -> None:
        """Take a gel at rest; of straightened images `offset` says where it lies beside the first rest image.

        So the regions of a model stay where the first one had them, to within the half pixel that is subtracted.
        `motion` is that of the picture when it was taken: what was learned of it since is noise, up to a knock.
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
        """Take what is computed of the rest image; all that was found beside it stays."""
        self._rest, self._reference, self._fit = rest, rest.image, rest.fit

    def begin_anew(self) -> None:  # what was found since the rest image came is forgotten
        self.set_reference(self._rest, self._base, self._resting)

    def straightened(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """The image as it would be had the camera stayed where it was; the image itself where that is near enough."""
        if self._straightening is None or self._reference is None:
            return image
        return self._straightening(image, self._reference)

    def without(self, field: DisplacementField) -> DisplacementField:
        """Motion found in a straightened image, without what was left of the whole picture's."""
        motion = field.displacement_px
        if self._remainder is not None and self._reference is not None:
            motion = motion - self._remainder.field_px(self._reference.shape, *motion.shape[:2])
        if self._offset is not None:
            motion = motion - self._offset
        return DisplacementField(motion, field.confidence)

    def at_rest(self, stamp_ns: int) -> None:
        """Take that nothing touches in a frame, and nothing moved."""
        self._rested = max(self._rested, 1) + 1
        if not self.settled:  # what is found where it was moved alike
            self._magnified_px = self.motion.terms[2] - self._grown_before_px
        self.settled, self.lost, self.found, self._last_ns = True, False, 1.0, stamp_ns
        self.surely = self.maybe = self.free = True
        self.dent.rested(surely=True)

    def look(self, straight: UInt8[np.ndarray, 'h w'], field: DisplacementField, stamp_ns: int) -> bool:
        """Take what the flow found in a frame; whether the frame is to be measured again, for the camera was knocked.

        Args:
            straight: the straightened image.
            field: motion in it without that of the whole picture.
            stamp_ns: when it was taken.
        """
        self.surely = self.maybe = self.free = False
        if self._rest.known_count < LEAST_FOUND * PATCHES**2:
            return False  # a pattern too sparse to tell
        motion, found = self._patches(straight, field)
        self.found = int(np.count_nonzero(found)) / self._rest.known_count
        self.lost = self.found < LEAST_FOUND
        if self.lost:
            return False
        weight = found.astype(float)
        terms = self._fit.common(motion, weight, rounds=2, about_none=True)
        if self._fit.size_px(terms) > 0.7 * KNOCK_PX:
            terms = self._fit.common(motion, weight)
            carried = self._fit.carried(terms)
            common = judge(motion[found], carried[found], self._fit.size_px(terms), self._noise_px)
            if common is not Common.NONE:
                return self._jump(terms) if common is Common.KNOCK else self._begin_anew()
        self._follow(motion, found, terms, field, stamp_ns)
        return False

    def _begin_anew(self) -> bool:
        """The gel has another shape and cannot be measured, unless only what is taken out makes it look so."""
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
        """After a knock: by this motion, or by none where it is none, as when the camera is back where it was."""
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
        """Where nothing touches: take on what is left of the whole picture's motion, quickly after a knock."""
        left = motion - self._fit.carried(terms)
        early = self._rested < SETTLE_FRAMES
        beside = self.dent.without(left - self._still, found, settled=self.settled)
        knocked_px = 0.0 if self.settled else self.size_px  # what a knock leaves is known once it is settled
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
            if self.maybe and not self.settled:  # something touched in those frames: begin anew
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
        """What each patch is off by once a knock was undone, as pixels fell elsewhere: the mean of the first frames."""
        share = np.float32(1 / self._rested)
        if self._rest.watch is not None:  # a dense search is off at rest as well, and its models learned that
            self._still += share * (left - self._still)
            return
        assert self._reference is not None
        rest = field.displacement_px - common.field_px(self._reference.shape, *field.displacement_px.shape[:2])
        self._offset = share * rest if self._offset is None else self._offset + share * rest

    def _off(self, field: DisplacementField) -> Float[np.ndarray, 'n 2']:
        """What each patch is off by once a knock was undone, as far as that is known."""
        if self._offset is None:
            return self._still
        return coarse(DisplacementField(self._offset, field.confidence))[0]

    def _forget_offset(self) -> None:
        self._offset = None
        self._still = np.zeros((PATCHES * PATCHES, 2))

    def _share(self, stamp_ns: int) -> float:
        """How much of what is seen is taken on, by the time since the last frame at rest."""
        passed_s = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) / NS_PER_S
        return 1 - math.exp(-min(max(passed_s, 0.0), 1.0) / self.options.follow_s)

    def _take(self, motion: PictureMotion, *, settled: bool) -> None:
        """From now on with this motion; images are straightened by it, or by one near enough."""
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
        """How far a straightening is from what it should be; shifts are near enough up to a limit."""
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
    """Patches of our own at half size; None of a picture too small for them."""
    if min(image.shape) < LEAST_SIDE_PX:
        return None
    options = InverseCompositionalOptions(rows=PATCHES, cols=PATCHES, finest_scale=1)
    flow = InverseCompositionalFlow(options, compiled=compiled)
    flow.set_reference(image)
    return flow


def believed(confidence: Float[np.ndarray, 'rows cols']) -> Bool[np.ndarray, ' patches']:
    """Which of 10x10 patches lie where a method believes anything at all: it does not where the gel is covered."""
    rows, cols = (np.arange(PATCHES) * count // PATCHES for count in confidence.shape)
    found: np.ndarray = (confidence > 0)[np.ix_(rows, cols)]
    return found.ravel()


def coarse(field: DisplacementField) -> tuple[Float[np.ndarray, 'patches 2'], Float[np.ndarray, ' patches']]:
    """Motion of 10x10 patches and the confidence in it."""
    assert field.confidence is not None
    motion, confidence = field.displacement_px, field.confidence
    if confidence.shape != (PATCHES, PATCHES):
        motion, confidence = fewer_means(motion, confidence, PATCHES, PATCHES)
    return motion.reshape(-1, 2).astype(float), confidence.reshape(-1).astype(float)
