"""The next rest image, prepared in a thread, so that no frame waits for it."""

from __future__ import annotations

import threading
from typing import ClassVar

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.rest.prepared import Measuring, PreparedRest
from tactile_nodes.shapes import UInt8


class Coming:
    """A rest image of straightened images, prepared in a thread and used from the stamp `due_ns` on.

    `offset` is its motion relative to the first rest image, `motion` that of the whole picture at its capture.
    """

    DERIVED: ClassVar = ('_found', '_thread')

    def __init__(
        self, image: UInt8[np.ndarray, 'h w'], due_ns: int, offset: PictureMotion, motion: PictureMotion
    ) -> None:
        self.image, self.due_ns, self.offset, self.motion = image, due_ns, offset, motion
        self._found: PreparedRest | ImageError | None = None
        self._thread: threading.Thread | None = None

    def begin(self, measuring: Measuring) -> None:
        """Start the preparation in a separate thread."""
        # Not a daemon: the process waits for it (some 0.1 s), as exiting within compiled code would abort.
        self._thread = threading.Thread(target=self._prepare, args=(measuring,), name='rest image')
        self._thread.start()

    def prepared(self) -> PreparedRest:
        """Wait for the result of the preparation. Call `begin` first.

        Raises:
            ImageError: no motion can be measured against this image.
        """
        self.wait()
        if isinstance(self._found, ImageError):
            raise self._found
        assert self._found is not None
        return self._found

    def wait(self) -> None:
        """Wait until the preparation ends. Call `begin` first."""
        assert self._thread is not None
        self._thread.join()

    def _prepare(self, measuring: Measuring) -> None:
        try:
            self._found = measuring.beside(self.image)
        except ImageError as error:
            self._found = error
