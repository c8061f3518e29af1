"""The next rest image, prepared beside the frames, so that none waits for it."""

from __future__ import annotations

import threading

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.rest.prepared import PreparedRest
from tactile_nodes.sensing.tracking import FeatureTracker


class Coming:
    """A rest image, made of straightened images, that is being prepared beside the frames; used from a stamp on.

    `offset` is where it lies beside the first rest image.
    """

    def __init__(
        self,
        tracker: FeatureTracker,
        image: UInt8[np.ndarray, 'h w'],
        due_ns: int,
    ) -> None:
        self.due_ns = due_ns
        registration = tracker.registration
        self.offset = registration.beside_frame if registration else None
        self.motion = registration.motion if registration else None
        self._found: PreparedRest | ImageError | None = None
        # Some 0.1 s that a process waits for when it ends: to end within compiled code would abort it.
        self._thread = threading.Thread(target=self._prepare, args=(tracker, image), name='rest image')
        self._thread.start()

    def prepared(self) -> PreparedRest:
        """What came of it.

        Raises:
            ImageError: nothing can be measured against it.
        """
        self._thread.join()
        if isinstance(self._found, ImageError):
            raise self._found
        assert self._found is not None
        return self._found

    def _prepare(self, tracker: FeatureTracker, image: UInt8[np.ndarray, 'h w']) -> None:
        try:
            self._found = tracker.prepared(image)
        except ImageError as error:
            self._found = error
