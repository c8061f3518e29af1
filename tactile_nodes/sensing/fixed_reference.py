"""Flow against a rest image that never changes: all that can be computed from it is computed once.

The general methods build pyramids, gradients and normal matrices of both images for every frame. Here a frame costs
its own pyramid and, for each patch, the dot products of `fixed_reference_patches`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.fixed_reference_patches import PatchGrid, Templates, moved_image, shrunk
from tactile_nodes.sensing.flow import DisplacementField, require_grey, require_like

AGAIN_PX = 0.6
"""A patch that turns out to lie further than this from where it was read is read again there."""

OWN_WORTH = 0.05
"""The confidence at which a patch's own measurement counts as much as its neighbours' mean."""

COARSE_WINDOW_PX = 13
COARSE_PITCH_PX = 11.0


@dataclass(frozen=True)
class InverseCompositionalOptions:
    """Options of the flow by patches.

    `rows` x `cols` patches, each `window` times as wide as their distance. `finest_scale` 0 measures at full size, 1 at
    half, 2 at a quarter. `levels` images, each half the size of the one before, are searched from the smallest on;
    with one level motion of more than about two pixels is lost. On each level patches that turn out to lie elsewhere
    are read again, `iterations` times altogether. `texture_grey` is the root mean square gradient (grey levels per
    pixel) at which a patch counts half. `threads` is what OpenCV is told to use.
    """

    rows: int = 40
    cols: int = 40
    finest_scale: int = 0
    levels: int = 3
    window: float = 1.4
    iterations: int = 3
    texture_grey: float = 4.0
    threads: int = 1


class InverseCompositionalFlow:
    """Inverse compositional Lucas-Kanade by patches: the field has one displacement a patch, with its confidence."""

    name = 'inverse_compositional'

    def __init__(self, options: InverseCompositionalOptions | None = None) -> None:
        self._options = options or InverseCompositionalOptions()
        _require_possible(self._options)
        self._reference: np.ndarray | None = None
        self._levels: list[Templates] = []

    @property
    def options(self) -> dict[str, object]:
        return asdict(self._options)

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        full = image.astype(np.float32)
        first = self._options.finest_scale
        levels = [self._templates(full, first + level) for level in range(self._options.levels)]
        self._reference, self._levels = image.copy(), levels

    def _templates(self, full: np.ndarray, scale: int) -> Templates:
        def moved(right: float, down: float) -> np.ndarray:
            return shrunk(moved_image(full, right * 2**scale, down * 2**scale), scale)

        return Templates(self._grid(shrunk(full, scale).shape, scale), moved)

    def _grid(self, shape: tuple[int, ...], scale: int) -> PatchGrid:
        options = self._options
        height, width = shape
        if scale == options.finest_scale:
            pitch = max(height / options.rows, width / options.cols)
            return PatchGrid((height, width), options.rows, options.cols, round(options.window * pitch))
        rows, cols = (max(1, round(side / COARSE_PITCH_PX)) for side in shape)
        return PatchGrid((height, width), rows, cols, COARSE_WINDOW_PX)

    def displacement(self, image: np.ndarray) -> DisplacementField:
        require_like(self._reference, image)
        if cv2.getNumThreads() != self._options.threads:
            cv2.setNumThreads(self._options.threads)
        pyramid = [shrunk(image, self._options.finest_scale)]
        for _ in self._levels[1:]:
            pyramid.append(shrunk(pyramid[-1]))
        motion = np.zeros((1, 1, 2), np.float32)
        confidence = np.zeros((1, 1), np.float32)
        for templates, picture in zip(reversed(self._levels), reversed(pyramid), strict=True):
            motion, confidence = self._refined(templates, picture, 2 * motion)
        return DisplacementField(motion * np.float32(2**self._options.finest_scale), confidence)

    def _refined(self, templates: Templates, picture: np.ndarray, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motion and confidence of one level's patches, from motion of another grid in this level's pixels."""
        grid = templates.grid
        start = cv2.resize(motion, (grid.cols, grid.rows), interpolation=cv2.INTER_LINEAR).reshape(-1, 2).T
        found = templates.find(picture, start)
        for _ in range(self._options.iterations - 1):
            far = np.flatnonzero(np.abs(found.motion_px - np.rint(start)).max(axis=0) > AGAIN_PX)
            if not far.size:
                break
            start = start.copy()
            start[:, far] = found.motion_px[:, far]
            nearer = templates.find(picture, start[:, far], far)
            found.motion_px[:, far], found.explained[far] = nearer.motion_px, nearer.explained
        texture = np.square(templates.texture_grey)
        known = texture / (texture + np.float32(self._options.texture_grey**2))
        confidence = (known * np.square(np.clip(found.explained, 0, 1))).reshape(grid.rows, grid.cols)
        return filled(found.motion_px.T.reshape(grid.rows, grid.cols, 2), confidence), confidence


def _require_possible(options: InverseCompositionalOptions) -> None:
    least = {'rows': 1, 'cols': 1, 'finest_scale': 0, 'levels': 1, 'iterations': 1, 'threads': 1}
    for name, value in least.items():
        if getattr(options, name) < value:
            raise ConfigurationError(
                f"option {name!r} of 'inverse_compositional' must be at least {value}, got {getattr(options, name)}"
            )


def filled(
    motion: Float32[np.ndarray, 'rows cols 2'], confidence: Float32[np.ndarray, 'rows cols']
) -> Float32[np.ndarray, 'rows cols 2']:
    """Motion in which patches of little confidence take after their neighbours; nothing known anywhere near is 0."""
    own = confidence[:, :, None]
    around = cv2.GaussianBlur(np.dstack([motion * own, own]), (5, 5), 1.0, borderType=cv2.BORDER_REFLECT_101)
    mean = around[:, :, :2] / (around[:, :, 2:] + np.float32(1e-3))
    worth = np.float32(OWN_WORTH)
    blend: np.ndarray = (own * motion + worth * mean) / (own + worth)
    return blend
