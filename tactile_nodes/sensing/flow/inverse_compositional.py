"""Flow against a fixed rest image: everything that depends on it alone is computed once.

General methods build pyramids, gradients and normal matrices of both images for every frame. Here a frame costs the dot
products of `flow.patches`, once for each patch, and once more for patches that moved to another pixel. There is no
pyramid: patches that are not found directly are found from the motion of their neighbours, or else by a dense search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.compiling import compiled_loops
from tactile_nodes.sensing.flow.methods import (
    DisFlow,
    DisOptions,
    DisplacementField,
    recorded_options,
    require_covered,
    require_grey,
    require_like,
)
from tactile_nodes.sensing.flow.patches import (
    LARGEST_ANSWER_PX,
    LEAST_GAIN,
    Match,
    Moved,
    PatchGrid,
    Templates,
    moved_image,
    shrunk,
)
from tactile_nodes.shapes import Float32, Int, UInt8

SMALLEST_PX = 16
"""Side of the smallest image that is measured."""

AGAIN_PX = 0.6
"""A patch that lies further than this from where it was read is read again there."""

LOST = 0.5
"""Least explained share of the contrast for a patch to count as found."""

ROUNDS = 2
"""How many times lost patches are searched along the motion of their neighbours."""

HOPELESS_SHARE = 0.2
"""Share of lost patches beyond which neighbours are not used."""

SEARCHES = ((DisOptions(preset='ultrafast', finest_scale=1), 1.0), (DisOptions(preset='medium', finest_scale=0), 5.0))
"""Dense searches of the image at half size, a cheap one and a thorough one, which takes four times as long: each from
how many times `search_share` of the patches on that are lost. Under a hard, wide contact some always are."""

AROUND, AROUND_PX = 3, 66
"""A search goes so many patches around those that are lost, and so far: a contact stretches what lies next to it. All
of the picture takes the slowest twentieth of frames 1.8 times as long, and forces come out alike to a tenth (force in
wrong bins 10.2 for 10.5 % of 40 contacts). A search needs 64 pixels."""

SEARCHED_PX = 64
"""Side of the smallest image that is searched."""

STRETCH_WORTH = 0.05
"""How much more of a patch must be explained once stretching is undone: doing so costs sharpness."""

OWN_WORTH = 0.05
"""The confidence at which a patch's own measurement counts as much as its neighbours' mean."""

LEAST_AROUND = 1e-3
"""Added to the neighbours' confidence: where there is none, motion is 0."""

_BLUR = cv2.getGaussianKernel(5, 1.0, cv2.CV_32F).reshape(-1)


@dataclass(frozen=True)
class InverseCompositionalOptions:
    """Options of the flow by patches.

    `rows` x `cols` patches, each `window` times as wide as their distance. `finest_scale` 0 measures at full size, 1 at
    half, 2 at a quarter. A patch is read at most `iterations` times from one start. `texture_grey` is the root mean
    square gradient, in grey levels per pixel, at which a patch counts half. When more than `search_share` of the
    patches are lost, a dense search is made: 1 never does. `threads` is the number that OpenCV uses. `covered` are the
    numbers of patches, row by row, that show no gel: nothing is believed there.
    """

    rows: int = 40
    cols: int = 40
    finest_scale: int = 0
    window: float = 1.2
    iterations: int = 3
    texture_grey: float = 4.0
    search_share: float = 0.01
    threads: int = 1
    covered: tuple[int, ...] = ()


class InverseCompositionalFlow:
    """Inverse compositional Lucas-Kanade by patches: the field has one displacement per patch, with its confidence."""

    name = 'inverse_compositional'

    def __init__(self, options: InverseCompositionalOptions | None = None, *, compiled: bool = False) -> None:
        self._options, self._compiled = options or InverseCompositionalOptions(), compiled
        _require_possible(self._options)
        self._reference: np.ndarray | None = None
        self._templates: Templates

    @property
    def options(self) -> dict[str, object]:
        return recorded_options(self._options)

    def set_reference(self, image: np.ndarray) -> None:
        require_grey(image)
        options = self._options
        height, width = (size >> options.finest_scale for size in image.shape)
        if min(height, width) < SMALLEST_PX:
            raise ImageError(
                f'finest_scale {options.finest_scale} leaves {width}x{height} of {image.shape[1]}x{image.shape[0]} '
                'pixels, too few to measure motion; choose a smaller finest_scale'
            )
        side = round(options.window * max(height / options.rows, width / options.cols))
        self._templates = Templates(
            PatchGrid((height, width), options.rows, options.cols, max(3, side)),
            self._moving(image),
            compiled=self._compiled,
        )
        self._reference = image.copy()
        texture = np.square(self._templates.texture_grey)
        self._known = texture / (texture + np.float32(options.texture_grey**2))
        self._known[list(options.covered)] = 0
        self._for_loops = (
            self._templates.grid.corner, self._templates.grid.window_px, self._templates.for_loops,
            (LEAST_GAIN, LARGEST_ANSWER_PX, AGAIN_PX, LOST), options.iterations, self._known, _BLUR,
            (OWN_WORTH, LEAST_AROUND, 2.0**options.finest_scale),
        )  # fmt: skip

    def _moving(self, image: np.ndarray) -> Moved:
        """A picture, at the resolution that is measured, moved right and down."""
        full, scale = image.astype(np.float32), self._options.finest_scale

        def moved(right_px: float, down_px: float) -> np.ndarray:
            by = 2**scale
            return shrunk(moved_image(full, right_px * by, down_px * by), scale)

        return moved

    def displacement(self, image: np.ndarray) -> DisplacementField:
        reference = require_like(self._reference, image)
        if cv2.getNumThreads() != self._options.threads:
            cv2.setNumThreads(self._options.threads)
        picture = np.ascontiguousarray(shrunk(image, self._options.finest_scale, compiled=self._compiled))
        if self._compiled:
            found, field, lost = self._displacement(picture)
            if not lost:
                return field
        else:
            found = self._settled(picture)
        if self._lost(found).size:
            self._recover(found, picture, (reference, image))
        motion, confidence = self._by_row(found)
        return DisplacementField(filled(motion, confidence) * np.float32(2**self._options.finest_scale), confidence)

    def _displacement(self, picture: np.ndarray) -> tuple[Match, DisplacementField, int]:
        """Matched patches, the reported motion, and the number of lost patches: compiled."""
        rows, cols = self._options.rows, self._options.cols
        motion, explained = np.empty((2, rows * cols), np.float32), np.empty(rows * cols, np.float32)
        field, confidence = np.empty((rows, cols, 2), np.float32), np.empty((rows, cols), np.float32)
        lost = compiled_loops().displacement(picture, *self._for_loops, motion, explained, field, confidence)
        return Match(motion, explained), DisplacementField(field, confidence), lost

    def _recover(
        self, found: Match, picture: np.ndarray, pair: tuple[UInt8[np.ndarray, 'h w'], UInt8[np.ndarray, 'h w']]
    ) -> None:
        """Search lost patches along the motion of their neighbours, and by dense search."""
        self._follow(found, picture)
        if min(pair[0].shape) < SEARCHED_PX:
            return
        for options, times in SEARCHES:
            if self._lost(found).size <= times * self._options.search_share * len(found.explained):
                return
            self._search(found, picture, pair, options)

    def _settled(self, picture: np.ndarray, start: np.ndarray | None = None, which: np.ndarray | None = None) -> Match:
        """Patches (all, or those numbered) found from `start`, and read again where they turned out to lie."""
        found = self._templates.find(picture, start, which)
        read = np.zeros_like(found.motion_px) if start is None else np.rint(start)
        for _ in range(self._options.iterations - 1):
            far = np.flatnonzero(np.abs(found.motion_px - read).max(axis=0) > AGAIN_PX)
            if not far.size:
                break
            read[:, far] = np.rint(found.motion_px[:, far])
            nearer = self._templates.find(picture, read[:, far], far if which is None else which[far])
            found.motion_px[:, far], found.explained[far] = nearer.motion_px, nearer.explained
        return found

    def _lost(self, found: Match) -> Int[np.ndarray, ' lost']:
        """Numbers of the patches that have texture but were not found."""
        return np.flatnonzero((found.explained < LOST) & (self._known > 0.5))

    def _follow(self, found: Match, picture: np.ndarray) -> None:
        """Search lost patches along the motion of their neighbours."""
        for _ in range(ROUNDS):
            lost = self._lost(found)
            if not 0 < lost.size < HOPELESS_SHARE * len(found.explained):
                return
            start = filled(*self._by_row(found)).reshape(-1, 2).T[:, lost]
            found.improve(self._settled(picture, start, lost), lost)

    def _search(
        self,
        found: Match,
        picture: np.ndarray,
        pair: tuple[UInt8[np.ndarray, 'h w'], UInt8[np.ndarray, 'h w']],
        options: DisOptions,
    ) -> None:
        """Start patches around those lost from a dense search of rest image and image as well; lost ones take its word.

        Those that are stretched are measured in an image in which the motion found was undone.
        """
        lost, scale = self._lost(found), self._options.finest_scale
        (rows, cols), part = self._around(lost)
        grid = self._templates.grid
        which = np.arange(grid.rows * grid.cols).reshape(grid.rows, grid.cols)[rows, cols]
        dense = dense_search(pair[0][part], pair[1][part], options, self._options.threads)
        start = np.float32(0.5**scale) * cv2.resize(dense, which.shape[::-1], interpolation=cv2.INTER_AREA)
        which, start = which.reshape(-1), start.reshape(-1, 2).T
        found.motion_px[:, lost], found.explained[lost] = start[:, np.isin(which, lost)], 0
        found.improve(self._settled(picture, start, which), which)
        straight = picture.copy()
        straight[tuple(slice(each.start >> scale, each.stop >> scale) for each in part)] = shrunk(
            undone(pair[1][part], dense), scale
        )
        left = self._templates.find(straight, None, which)
        found.improve(Match(start + left.motion_px, left.explained), which, least=STRETCH_WORTH)

    def _around(self, lost: Int[np.ndarray, ' lost']) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Rows and columns of the patches around some, and the rows and columns of pixels that those see."""
        assert self._reference is not None
        (height, width), grid = self._reference.shape, self._templates.grid
        row, col = np.divmod(lost, grid.cols)
        sides = self._along(row, grid.rows, height), self._along(col, grid.cols, width)
        return (sides[0][0], sides[1][0]), (sides[0][1], sides[1][1])

    def _along(self, lost: Int[np.ndarray, ' lost'], count: int, size_px: int) -> tuple[slice, slice]:
        """The same along one side of the image; pixels begin and end where those of a smaller one do, too."""
        more, scale = max(AROUND, math.ceil(AROUND_PX * count / size_px)), self._options.finest_scale
        first, past = max(int(lost.min()) - more, 0), min(int(lost.max()) + 1 + more, count)
        return slice(first, past), slice(*(size_px * each // count >> scale << scale for each in (first, past)))

    def _by_row(self, found: Match) -> tuple[np.ndarray, np.ndarray]:
        """Motion and confidence as (rows, cols, 2) and (rows, cols)."""
        shape = self._templates.grid.rows, self._templates.grid.cols
        confidence = self._known * np.square(np.clip(found.explained, 0, 1))
        return found.motion_px.T.reshape(*shape, 2), confidence.reshape(shape)


def _require_possible(options: InverseCompositionalOptions) -> None:
    least = {'rows': 1, 'cols': 1, 'finest_scale': 0, 'iterations': 1, 'threads': 1, 'window': 0.5}
    for name, value in least.items():
        if getattr(options, name) < value:
            raise ConfigurationError(
                f"option {name!r} of 'inverse_compositional' must be at least {value}, got {getattr(options, name)}"
            )
    require_covered('inverse_compositional', options.covered, options.rows, options.cols)


def filled(
    motion: Float32[np.ndarray, 'rows cols 2'], confidence: Float32[np.ndarray, 'rows cols']
) -> Float32[np.ndarray, 'rows cols 2']:
    """Motion in which patches of low confidence follow their neighbours; without confident neighbours it is 0."""
    known = np.empty((*confidence.shape, 3), np.float32)
    known[:, :, 2] = confidence
    np.multiply(motion, known[:, :, 2:], out=known[:, :, :2])
    around = cv2.sepFilter2D(known, -1, _BLUR, _BLUR, borderType=cv2.BORDER_REFLECT_101)
    around[:, :, :2] *= np.float32(OWN_WORTH) / (around[:, :, 2:] + np.float32(LEAST_AROUND))
    blend: np.ndarray = (known[:, :, :2] + around[:, :, :2]) / (known[:, :, 2:] + np.float32(OWN_WORTH))
    return blend


def dense_search(
    reference: UInt8[np.ndarray, 'h w'], image: UInt8[np.ndarray, 'h w'], options: DisOptions, threads: int
) -> Float32[np.ndarray, 'h w 2']:
    """Displacement of each pixel by dense inverse search at half size."""
    search = DisFlow(replace(options, threads=threads))
    search.set_reference(shrunk(reference))
    field = search.displacement(shrunk(image)).displacement_px
    dense: np.ndarray = cv2.resize(2 * field, image.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return dense


def undone(image: UInt8[np.ndarray, 'h w'], motion: Float32[np.ndarray, 'h w 2']) -> UInt8[np.ndarray, 'h w']:
    """The image with its content moved back to its places at rest."""
    height, width = image.shape
    x, y = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)[:, None]
    across, down = motion[:, :, 0] + x, motion[:, :, 1] + y
    straight: np.ndarray = cv2.remap(image, across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    return straight
