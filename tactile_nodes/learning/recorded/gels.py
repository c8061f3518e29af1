"""Notices that the rest images of a data set show more than one gel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tactile_nodes.errors import ImageError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.sensing.picture.change import PictureComparison
from tactile_nodes.shapes import UInt8

OTHER = 'its rest image shows other markers than that of the model: another gel, or the camera was moved far'


def other_markers(one: UInt8[np.ndarray, 'h w'], other: UInt8[np.ndarray, 'h w']) -> bool:
    """Whether two rest images show different markers; not if one is missing or they cannot be compared."""
    try:
        return bool(one.size and other.size) and not PictureComparison(one).of(other).same
    except ImageError:
        return False


class Gels:
    """Compares each new rest image with the first one, and warns of other markers."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._seen = progress, {''}
        self._first: tuple[Path, PictureComparison] | None = None

    def see(self, file: Path, measurer: Measurer) -> None:
        """Take the rest image that presses of a bag or table are measured against."""
        if measurer.reference_id in self._seen:
            return
        self._seen.add(measurer.reference_id)
        try:
            if self._first is None:
                self._first = file, PictureComparison(measurer.rest_image)
            elif not self._first[1].of(measurer.rest_image).same:
                self._progress.say(
                    f'{file}: a rest image shows other markers than the first one of {self._first[0]}: it is another '
                    'gel, or the camera was moved far; give each gel a data set of its own'
                )
        except ImageError:
            return  # with too little pattern for a comparison
