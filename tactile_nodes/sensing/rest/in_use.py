"""The rest image in use and its origin."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.picture.quality import PictureLikeness
from tactile_nodes.sensing.rest.prepared import PreparedRest


@dataclass(frozen=True)
class RestInUse:
    """The rest image that frames are measured against.

    `likeness` compares pictures with it, `captured` with the rest image that was captured or given. `renewed`: it came
    into use automatically. `another`: it differs from the captured one. `unsteady`: frames of the capture did not show
    the same. `added` is how much sharper frames are than the mean of the capture because of their noise, `noise_grey`
    that noise (grey levels; 0: unknown). If it was made of straightened images, `offset` is its motion relative to the
    first rest image, and `motion` that of the whole picture at its capture.
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
        """Whether the flow method is dense inverse search, which mistakes light and changed pixels for motion."""
        return self.prepared.flow.name == 'dis'
