"""Selects the frames of a rest image: consecutive frames that show the same picture without contact."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.picture.stillness import StillnessCheck
from tactile_nodes.sensing.rest.reference import RestAccumulator
from tactile_nodes.shapes import UInt8

PATIENCE = 4
"""A capture waits for frames that show the same up to this many times its own length."""

LEAST_RUN = 4
"""So many equal frames in a row count as the gel at rest, unless later frames show that it was released."""

MOST_RUNS = 8
"""A frame is compared with at most so many earlier runs."""


class RestCapture:
    """Collects `wanted` frames for a rest image.

    Consecutive frames that show the same form a run. A frame that shows something else begins a new run. A frame that
    shows a touch, compared with any earlier run, is discarded. A frame of another size starts the capture again.
    `unsteady`: no run was long enough in time, so any frames were used. This never happens while touches come and go.
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
        """Why there is no rest image although frames for two have arrived; empty before that."""
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
        """Take one more frame. Returns the rest image once it is complete, and then restarts the capture.

        Raises:
            ImageError: the frame is black or overexposed, and was skipped.
        """
        if self._left_to_skip > 0:
            self._left_to_skip -= 1
            return None
        require_picture(image)
        shown = self._first.reference if self._first else None
        if shown is not None and shown.shape != image.shape:
            self._frames, self._first, self._earlier = RestAccumulator(), None, []
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
        if self._frames.count < self._wanted:
            return None
        finished, self._frames = self._frames.image(), RestAccumulator()
        return finished

    def _same(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a frame shows the same as the run."""
        return self._frames.count > 0 and self._first is not None and self._first.same(image)

    def _take_another(self, shown: StillnessCheck) -> None:
        """Begin a new run with a frame that differs, or continue the old one if the picture never rests."""
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
        """Stop the count of frames at the limit of patience, so that a touch never becomes a rest image."""
        self._offered = min(self._offered, PATIENCE * self._wanted)


def _about(image: UInt8[np.ndarray, 'h w']) -> StillnessCheck:
    check = StillnessCheck()
    check.set_reference(image)
    return check


def _touched(one: StillnessCheck, other: StillnessCheck) -> bool:
    """Whether something presses the gel in only one of two pictures."""
    assert one.reference is not None and other.reference is not None
    return one.pressed(other.reference) or other.pressed(one.reference)
