"""The rest image in use: captured, renewed while nothing touches, and what there is to say of a picture beside it."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from tactile_nodes import conversions
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import ImageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.sensing.coming import Coming
from tactile_nodes.sensing.picture.knocks import KNOCK_PX
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.quality import PictureLikeness, sharpness
from tactile_nodes.sensing.picture.quietness import EXPLAINED
from tactile_nodes.sensing.picture.registration import FEW_FOUND, Registration
from tactile_nodes.sensing.picture.stillness import steady
from tactile_nodes.sensing.rest.prepared import PreparedRest
from tactile_nodes.sensing.rest.renewal import Renewal, RenewalOptions, Rested
from tactile_nodes.sensing.tracking import FeatureTracker

FORCE = types.ForceDistribution
GROWN_PX = 0.15
"""No knock makes a picture larger: a gel that swells by 0.1 mm grows it by 0.3 px at the rim, and reads 3 % less."""

LOOK_EVERY, NO_TOUCH = 4, 40.0
"""Of frames that are not at rest one in so many is looked at more closely, and believed where no more than 25 mN touch
(motion in units of what noise makes of it)."""

MOST_LIGHT_SHARE = 0.05
"""A dense search takes light for motion: where any block of the picture is brighter or darker by more, it is off."""

MOST_NOISE = 1.3
"""What is left of the middle of the picture, beside motion and light, over what the captured rest image leaves: at rest
within 2 %. JPEG of quality 90 leaves 1.34, a blur of 0.5 px 2.6, one stuck pixel of a thousand 3.3."""

BEYOND_NOISE = 4.5
"""So many times as much is another picture: noise of four times leaves 3.7, of eight 7.1, JPEG of quality 30 leaves 5.0
and is read 4 % short by half-size patches, which find it hardly less sharp."""

MOST_DEAD = 0.01
"""Share of the pixels from which a picture with dead ones filled in is another: of 5 % a frame is up to 1.8 times as
wrong, of 2 % 1.6 times."""

ELSEWHERE_PX = 0.15
"""Moved by half a pixel and straightened, a picture of markers of three pixels is not what it was: patches read motion
in it up to two percent off, most of all those at full size."""

PREPARE_S = 0.2
"""From the last frame of a renewed rest image until it is used, so that which frame is the first is no chance."""


class RestImages:
    """Keeps the rest image that a tracker measures against that of the present picture.

    `trouble` says why there is none; `renewed` whether the last one was taken by itself.
    """

    def __init__(self, tracker: FeatureTracker, flow: str, renewal: RenewalOptions | None) -> None:
        self._tracker = tracker
        self._flow, self._dense = flow, flow == 'dis'
        self._renewal = Renewal(renewal) if renewal else None
        self._now: PictureLikeness | None = None
        self._captured: PictureLikeness | None = None
        self._first: PreparedRest | None = None
        self._changed = self._blurred = False
        self._added: float | None = None
        self._seen, self._gone, self._noise_grey, self._unlooked = 0, False, 0.0, 0
        self._odd = self._soft = False
        self._coming: Coming | None = None
        self._announced: types.Image | None = None
        self.trouble, self.renewed = '', False

    def use(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> None:
        """Measure against this rest image from now on.

        Raises:
            ImageError: nothing can be measured against it; the one before stays in use.
        """
        self._tracker.use_captured(image)
        self._announce(head)

    def offer(self, image: UInt8[np.ndarray, 'h w'], head: types.Header) -> None:
        """Give a frame to the capture under way."""
        try:
            if self._tracker.offer_rest(image):
                image = self._tracker.dead.mended(image)
                assert self._tracker.reference is not None
                self._announce(head, added=sharpness(image) - sharpness(self._tracker.reference))
                seen = self._tracker.stillness(image)
                self._noise_grey = seen.noise_grey if seen else 0.0
            self.trouble = self._tracker.refused or self._tracker.waiting
        except ImageError as error:
            self.trouble = str(error)

    def announced(self) -> types.Image | None:
        """The rest image that came into use since this was asked last, if one did: to be published."""
        message, self._announced = self._announced, None
        return message

    def take_coming(self, head: types.Header) -> None:
        """Measure against the renewed rest image from the first frame on that is due."""
        coming, at_ns = self._coming, stamp_ns(head.stamp)
        if coming is None or 0 <= coming.due_ns - at_ns <= 2 * PREPARE_S * NS_PER_S:
            return
        self._coming = None
        try:
            rest = coming.prepared()
        except ImageError as error:
            self.trouble = str(error)
            return
        self._tracker.use(rest, offset=coming.offset, motion=coming.motion)
        self._announce(head, renewed=True)

    def mended(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w']:
        """A frame as it is to be measured, with dead pixels filled in; a capture looks for its own."""
        return image if self._tracker.capturing else self._tracker.dead.mended(image)

    def faint(self, level: float) -> bool:
        """Whether a frame of this mean grey has too little of the light of the captured rest image."""
        return self._captured is not None and self._captured.faint(level)

    def judge(self, image: UInt8[np.ndarray, 'h w'], level: float, head: types.Header) -> int:
        """What there is to say of a frame that was measured; it may become part of the next rest image."""
        still = self._tracker.still
        reasons = self._moved() | (self._tracker.unsteady or self._dented) * FORCE.REASON_REST_DOUBTFUL
        self._changed = self._blurred = False
        if not still or self._seen & FORCE.REASON_BLURRED:  # a little blur leaves frames still
            reasons |= self._unlike(image, level, head)
        guessed = self._tracker.dead.count > MOST_DEAD * image.size
        reasons |= (self._tracker.banded or guessed) * FORCE.REASON_LIGHT_CHANGED
        reasons |= self._look_closer()
        if not (self._odd and self._find_dead(image, stamp_ns(head.stamp))):
            self._offer_renewal(stamp_ns(head.stamp), still)
        return reasons

    def _look_closer(self) -> int:
        """What frames show of the picture beside motion: those at rest, and of the others one in so many."""
        registration = self._tracker.registration
        self._odd |= registration is not None and (registration.lost or not registration.settled)
        self._unlooked = 0 if registration is None or registration.maybe else self._unlooked + 1
        if registration is None or not registration.settled or self._unlooked % LOOK_EVERY:
            return self._seen
        if (seen := self._tracker.stillness(self._tracker.straight)) is None or seen.motion > NO_TOUCH:
            return self._seen
        gone = seen.unexplained or registration.explained < EXPLAINED
        self._gone = self._gone or gone if self._beside_another else gone
        usual = self._noise_grey = self._noise_grey or seen.noise_grey
        noisy = seen.noise_grey > MOST_NOISE * usual
        self._odd = seen.unexplained or noisy
        other_light = self._dense and seen.light_share > MOST_LIGHT_SHARE
        self._changed |= other_light
        # What blur takes of the pattern no lamp brings back.
        lit = other_light or (self._gone and not self._soft) or seen.noise_grey > BEYOND_NOISE * usual
        self._seen = lit * FORCE.REASON_LIGHT_CHANGED | noisy * FORCE.REASON_BLURRED
        return self._seen

    def _find_dead(self, image: UInt8[np.ndarray, 'h w'], at_ns: int) -> bool:
        """A picture that is odd at rest may be so by dead pixels alone; whether some were found in this frame.

        They are filled in from the next one on, and what was collected for a rest image is forgotten.
        """
        registration = self._tracker.registration
        if registration is None or registration.straightening is not None:
            return False
        if not self._tracker.dead.look(image, self._still):
            return False
        self._coming, self._odd = None, False
        registration.begin_anew()
        if self._renewal is not None:
            self._renewal.taken(at_ns, renewed=False)
        return True

    def _still(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a picture shows what the rest image shows, as sharply as it did, and nothing touches."""
        seen = self._tracker.stillness(image)
        if seen is None or seen.unexplained or seen.noise_grey > MOST_NOISE * (self._noise_grey or seen.noise_grey):
            return False
        return steady(seen)

    def _moved(self) -> int:
        """What there is to say of the whole picture's motion."""
        registration = self._tracker.registration
        if registration is None:
            return 0
        told = {
            FORCE.REASON_PICTURE_LOST: registration.lost,
            FORCE.REASON_FOREIGN_MOTION: not registration.settled
            or self._apart(registration)
            or registration.grown_px > GROWN_PX,
            FORCE.REASON_LOW_CONFIDENCE: registration.found < FEW_FOUND,
        }
        return sum(reason for reason, present in told.items() if present)

    def _unlike(self, image: UInt8[np.ndarray, 'h w'], level: float, head: types.Header) -> int:
        """What there is to say of the picture as a picture, beside the rest image and beside the one captured."""
        if self._now is None or self._captured is None:
            return 0
        sharp = sharpness(image, compiled=self._tracker.compiled)
        beside = self._now.near(level, sharp)
        self._changed, self._blurred = beside.light or beside.blurred, beside.blurred
        told = beside | self._captured.far(level, sharp)
        self._soft = told.blurred
        other = beside or self._captured.as_sharp(sharp, of=self._now.sharpness)
        if other and self._beside_another and not self._captured.near(level, sharp):
            assert self._first is not None
            self._tracker.use(self._first, offset=PictureMotion(), motion=PictureMotion())  # all is as it was
            self._announce(head, renewed=True)
        return told.light * FORCE.REASON_LIGHT_CHANGED | (told.blurred | told.noisy) * FORCE.REASON_BLURRED

    def _offer_renewal(self, at_ns: int, still: bool) -> None:
        """Give the frame to the renewal of the rest image; what comes of it is prepared beside the next frames."""
        registration, straight = self._tracker.registration, self._tracker.straight
        if self._renewal is None or registration is None or straight is None or self._coming is not None:
            return
        apart = self._apart(registration) or self._elsewhere or self._dented or self._blurred
        changed = apart or (not still and (self._changed or registration.explained < EXPLAINED))
        fit = registration.settled and not self._tracker.banded
        like, changed = (still and not apart, changed) if fit else (True, False)
        rested = Rested(registration.surely, registration.maybe, like, changed)
        image = self._renewal.offer(straight, at_ns, rested, registration.straightening)
        if image is not None:
            image = self._tracker.dead.renewed(image) if registration.straightening is None else image
            due_ns = at_ns + round(PREPARE_S * NS_PER_S)
            self._coming = Coming(self._tracker, image, due_ns)

    @property
    def _beside_another(self) -> bool:
        """Whether the rest image in use is another than the captured one."""
        return self._first is not None and self._tracker.reference is not self._first.image

    @property
    def _dented(self) -> bool:
        """Whether something touched in the rest image."""
        return self._tracker.registration is not None and self._tracker.registration.dent.dented

    def _apart(self, registration: Registration) -> bool:
        """Whether a dense search, whose errors depend on where pixels fall, is off since the rest image was taken."""
        return self._dense and registration.apart_px > KNOCK_PX

    @property
    def _elsewhere(self) -> bool:
        """Whether patches read a picture that fell elsewhere on the camera's pixels than the rest image's.

        More than its noise is left over then, above all where a gel was seated anew, and it gets a rest image anyway.
        """
        registration = self._tracker.registration
        return registration is not None and not self._dense and registration.apart_px > ELSEWHERE_PX

    def _announce(self, head: types.Header, *, renewed: bool = False, added: float | None = None) -> None:
        image = self._tracker.reference
        assert image is not None
        self._added = self._added if renewed else added
        self.trouble, self.renewed = '', renewed
        self._now = PictureLikeness(image, self._flow, self._added, renewed=renewed)
        if renewed and self._tracker.rest is self._first:
            self._now = self._captured
        self._tracker.dead.beside(image)
        if not renewed:
            self._coming, self._captured, self._first = None, self._now, self._tracker.rest
            self._seen, self._noise_grey = 0, 0.0
            self._gone = self._odd = self._soft = False
        if self._renewal is not None:
            self._renewal.taken(stamp_ns(head.stamp), renewed=renewed)
        self._announced = conversions.image_message(image, head)
