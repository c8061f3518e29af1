"""Which frames become the rest image: those that follow one another, show the same, and show nothing that touches."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.picture.stillness import StillnessCheck, steady
from tactile_nodes.sensing.rest.reference import RestAccumulator

PATIENCE = 4
"""A capture waits so many times as long as it takes for frames that show the same."""

LEAST_RUN = 4
"""So many frames in a row that show the same are the gel at rest, unless what follows says that it was released."""


class RestCapture:
    """Collects `wanted` frames for a rest image.

    Frames that show the same make a run. A frame that shows something else begins a new one; of one that shows a touch
    beside an earlier run nothing is taken. `unsteady`: no run came for too long, and any frames were taken.
    """

    def __init__(self, wanted: int, skip: int = 0) -> None:
        self.unsteady = self.touched = False
        self._wanted, self._left_to_skip = wanted, skip
        self._offered, self._longest = 0, 0
        self._frames = RestAccumulator()
        self._first: StillnessCheck | None = None
        self._earlier: StillnessCheck | None = None

    @property
    def waiting(self) -> str:
        """Why there is no rest image though frames for two have come; empty while it may still be on its way."""
        if self._offered < 2 * self._wanted:
            return ''
        why = (
            'something touches the gel now that did not before'
            if self.touched
            else 'the picture goes on changing, as when something touches or the camera moves'
        )
        return (
            f'no rest image yet: it takes {self._wanted} frames in a row of the untouched gel, '
            f'and {self._longest} came; {why}. Leave the gel untouched, ask for fewer frames (reference_frames), '
            'or give a picture of the gel at rest (reference:=file reference_file:=…)'
        )

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
        self.touched = self._earlier is not None and self._earlier.pressed(image)
        if self.touched:
            self._offered = min(self._offered, PATIENCE * self._wanted)  # no patience makes a touch a rest image
            self._frames = RestAccumulator()
            return None
        if not self._same(image):
            self._begin_run(image)
        self._frames.add(image)
        self._longest = max(self._longest, self._frames.count)
        return self._finished() if self._frames.count >= self._wanted else None

    def _same(self, image: UInt8[np.ndarray, 'h w']) -> bool:
        """Whether a frame shows what the run shows; of a picture that never rests all frames do."""
        if self._frames.count and self._first is not None and self._shows_the_same(self._first, image):
            return True
        self.unsteady = self._offered > PATIENCE * self._wanted
        return self.unsteady and self._frames.count > 0

    @staticmethod
    def _shows_the_same(first: StillnessCheck, image: UInt8[np.ndarray, 'h w']) -> bool:
        return not first.able or steady(first.look(image))

    def _begin_run(self, image: UInt8[np.ndarray, 'h w']) -> None:
        if self._frames.count >= LEAST_RUN:
            self._earlier = self._first
        self._frames, self._first = RestAccumulator(), StillnessCheck()
        self._first.set_reference(image)

    def _finished(self) -> UInt8[np.ndarray, 'h w']:
        image, self._frames = self._frames.image(), RestAccumulator()
        return image
