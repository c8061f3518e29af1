"""Which frames become the rest image: those that follow one another, show the same, and show nothing that touches."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.picture.stillness import StillnessCheck
from tactile_nodes.sensing.rest.reference import RestAccumulator

PATIENCE = 4
"""A capture waits so many times as long as it takes for frames that show the same."""

LEAST_RUN = 4
"""So many frames in a row that show the same are the gel at rest, unless what follows says that it was released."""

MOST_RUNS = 8
"""With so many earlier runs a frame is compared."""


class RestCapture:
    """Collects `wanted` frames for a rest image.

    Frames that show the same make a run. A frame that shows something else begins a new one; of one that shows a touch
    beside any earlier run nothing is taken. `unsteady`: no run came for too long, and any frames were taken; not while
    touches come and go, which patience does not wait for.
    """

    def __init__(self, wanted: int, skip: int = 0) -> None:
        self.unsteady = self.touched = self._comes_and_goes = False
        self._wanted, self._left_to_skip = wanted, skip
        self._offered, self._longest = 0, 0
        self._frames = RestAccumulator()
        self._first: StillnessCheck | None = None
        self._earlier: list[StillnessCheck] = []

    @property
    def waiting(self) -> str:
        """Why there is no rest image though frames for two have come; empty while it may still be on its way."""
        if self._offered < 2 * self._wanted:
            return ''
        return (
            f'no rest image yet: it takes {self._wanted} frames in a row of the untouched gel, '
            f'but only {self._longest} came; {self._why}. Leave the gel untouched, set fewer frames '
            '(reference_frames), or give an image of the gel at rest (reference:=file reference_file:=…)'
        )

    @property
    def _why(self) -> str:
        if self.touched:
            return 'something touches the gel now but did not before'
        if self._comes_and_goes:
            return 'something touches the gel in some frames but not in others (or the camera changes its focus)'
        return 'the image keeps changing, as when the camera moves'

    def offer(self, image: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h w'] | None:
        """Take one frame more; the rest image, once it is complete. The capture then begins anew.

        Raises:
            ImageError: the frame is black or overexposed, and was left out.
        """
        if self._left_to_skip > 0:
            self._left_to_skip -= 1
            return None
        require_picture(image)
        self._offered += 1
        self.touched = any(earlier.pressed(image) for earlier in self._earlier)
        if self.touched:
            self._have_no_patience()
            self._frames = RestAccumulator()
            return None
        if not self._same(image):
            self._take_another(_about(image))
        self._frames.add(image)
        self._longest = max(self._longest, self._frames.count)
        return self._finished() if self._frames.count >= self._wanted else None

    def _same(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a frame shows what the run shows."""
        return self._frames.count > 0 and self._first is not None and self._first.same(image)

    def _take_another(self, shown: StillnessCheck) -> None:
        """A frame that shows something else begins a new run; of a picture that never rests it goes on with the old."""
        self._comes_and_goes = self._first is not None and _touched(self._first, shown)
        if self._comes_and_goes:
            self._have_no_patience()
        self.unsteady = self._offered > PATIENCE * self._wanted
        if self.unsteady and self._frames.count:
            return
        if self._frames.count >= LEAST_RUN and self._first is not None:
            self._earlier = [*self._earlier[1 - MOST_RUNS :], self._first]
        self._frames, self._first = RestAccumulator(), shown

    def _have_no_patience(self) -> None:
        """No patience makes a touch a rest image."""
        self._offered = min(self._offered, PATIENCE * self._wanted)

    def _finished(self) -> UInt8[np.ndarray, 'h w']:
        image, self._frames = self._frames.image(), RestAccumulator()
        return image


def _about(image: UInt8[np.ndarray, 'h w']) -> StillnessCheck:
    check = StillnessCheck()
    check.set_reference(image)
    return check


def _touched(one: StillnessCheck, other: StillnessCheck) -> bool:
    """Whether something presses in one of two pictures that does not in the other."""
    assert one.reference is not None and other.reference is not None
    return one.pressed(other.reference) or other.pressed(one.reference)
