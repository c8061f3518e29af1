"""The rest image in use, and how it came to be that."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.quality import PictureLikeness
from tactile_nodes.sensing.rest.prepared import PreparedRest


@dataclass(frozen=True)
class RestInUse:
    """What frames are measured against.

    `likeness` tells whether a picture is like it, `captured` whether it is like the rest image that was captured or
    given. `renewed`: this one came into use by itself; `another`: it is another than that one. `unsteady`: frames of
    the capture did not show the same. `added` is how much sharper frames are by their noise than the mean of the
    capture, `noise_grey` that noise (grey levels), 0 where it is not known. `offset` is where it lies beside the first
    rest image, if it was made of straightened images, and `motion` that of the whole picture when they were taken.
    """

    prepared: PreparedRest
    likeness: PictureLikeness
    captured: PictureLikeness
    renewed: bool = False
    another: bool = False
    unsteady: bool = False
    added: float | None = None
    noise_grey: float = 0.0
    offset: PictureMotion | None = None
    motion: PictureMotion | None = None

    @property
    def dense(self) -> bool:
        """Whether it is searched densely, by what takes light and other pixels for motion."""
        return self.prepared.flow.name == 'dis'
