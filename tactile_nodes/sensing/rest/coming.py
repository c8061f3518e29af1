"""The next rest image, prepared beside the frames, so that none waits for it."""

from __future__ import annotations

import threading
from typing import ClassVar

import numpy as np
from jaxtyping import UInt8

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest


class Coming:
    """A rest image, made of straightened images, that is being prepared beside the frames; used from a stamp on.

    `offset` is where it lies beside the first rest image, `motion` that of the whole picture when it was taken.
    """

    DERIVED: ClassVar = ('_found', '_thread')

    def __init__(
        self, image: UInt8[np.ndarray, 'h w'], due_ns: int, offset: PictureMotion, motion: PictureMotion
    ) -> None:
        self.image, self.due_ns, self.offset, self.motion = image, due_ns, offset, motion
        self._found: PreparedRest | ImageError | None = None
        self._thread: threading.Thread | None = None

    def begin(self, measuring: Measuring) -> None:
        """Prepare it, in a thread of its own."""
        # Some 0.1 s that a process waits for when it ends: to end within compiled code would abort it.
        self._thread = threading.Thread(target=self._prepare, args=(measuring,), name='rest image')
        self._thread.start()

    def prepared(self) -> PreparedRest:
        """What came of it, once it has begun.

        Raises:
            ImageError: nothing can be measured against it.
        """
        self.wait()
        if isinstance(self._found, ImageError):
            raise self._found
        assert self._found is not None
        return self._found

    def wait(self) -> None:
        """Until it is prepared, once that has begun."""
        assert self._thread is not None
        self._thread.join()

    def _prepare(self, measuring: Measuring) -> None:
        try:
            self._found = measuring.beside(self.image)
        except ImageError as error:
            self._found = error
