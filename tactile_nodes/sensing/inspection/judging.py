"""Checks pictures of an untouched sensor against its description, with findings as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import cv2
import numpy as np

from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.sensing.elasticity.rays import described_dots
from tactile_nodes.sensing.elasticity.region_choice import LEAST_SEEN, usual_regions
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.features import RegionOptions, texture_confidence
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.flow.dot_pattern import Dots, find_dots
from tactile_nodes.sensing.flow.dots import NO_TEXTURE, DotsFlow
from tactile_nodes.sensing.flow.inverse_compositional import InverseCompositionalFlow
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.sensing.inspection.dot_grid import dot_findings, not_random
from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK, Finding, percent
from tactile_nodes.sensing.inspection.markers import Markers, beside
from tactile_nodes.sensing.inspection.stillness import alike, apart_px
from tactile_nodes.sensing.inspection.texture import looks_covered
from tactile_nodes.sensing.picture.quality import picture_faults, require_rest_image
from tactile_nodes.sensors import ImageSettings, Sensor
from tactile_nodes.shapes import Bool, Float, UInt8

DIM_GREY, BURNT_SHARE, FLICKER = 60, 0.01, 0.02
"""Least grey level of the brightest parts; largest share of overexposed pixels; largest change of light."""

LEAST_EDGE_PX = 2.5
"""Blur of dot edges from which the focus counts as bad."""

LITTLE_SEEN, HARDLY_SEEN, PLACES = 0.5, 0.1, 200
"""Shares of the described gel that a picture should show, and must show; sampled places along its longer side."""

MEASURED, MARKED, MOST_MARKED = 0.1, 0.5, 0.9
"""Least confidence at which models of described sensors use a region's motion; share of the usable regions that must
reach it, and that should."""

UNSTEADY_PX, UNEVEN_PX = 0.3, 0.1
"""Motion at rest of all regions, and of single regions relative to them, from which something moves or flickers."""

UNMASKED = 0.01
"""Share of the picture that may look covered without being in the mask."""


MOST_PX = 1400
"""Longer side of the used part beyond which the motion of a texture is underestimated. A press by a ball of 5 mm on
`speckle_membrane`, 640x480, moves the image enlarged 2, 3 and 4 times by 3, 7 and 14 % less than the original."""


class Inspection:
    """Inspects pictures of a sensor that nothing touches.

    Args:
        sensor: its description.
        pictures: full grey pictures of the camera by name, at least one.

    Raises:
        ConfigurationError: the size of a picture differs from the description.
    """

    def __init__(self, sensor: Sensor, pictures: Mapping[str, UInt8[np.ndarray, 'h w']]) -> None:
        self.sensor, self.regions = sensor, usual_regions(sensor)
        image = sensor.image
        for name, picture in pictures.items():
            if picture.shape != (image.height, image.width):
                raise ConfigurationError(
                    f'{name} has {picture.shape[1]}x{picture.shape[0]} pixels, but image of {sensor.name} says '
                    f'{image.width}x{image.height}; set the camera to that size, or change image.width and image.height'
                )
        crop = Crop.centred(image.width, image.height, *image.crop_px)
        self._names = [*pictures]
        self.pictures = [np.ascontiguousarray(crop.apply(each)) for each in pictures.values()]

    @cached_property
    def rest(self) -> UInt8[np.ndarray, 'h w']:
        """The mean of all pictures, cropped as the sensor's are."""
        return np.asarray(np.rint(np.mean(self.pictures, axis=0)), np.uint8)

    @cached_property
    def gel(self) -> Bool[np.ndarray, 'h w']:
        """Where the picture should show the gel, without the masked parts."""
        return np.asarray(self._within & ~self.sensor.covered)

    @cached_property
    def _within(self) -> Bool[np.ndarray, 'h w']:
        """The area within the gel's outline, covered or not."""
        drawn = np.zeros(self.rest.shape, np.uint8)
        cv2.fillPoly(drawn, [np.rint(outline_px(self.regions)).astype(np.int32)], 1)
        return np.asarray(drawn > 0)

    @cached_property
    def dots(self) -> Dots | None:
        """Printed dots in the picture."""
        return find_dots(np.where(self.sensor.covered, np.uint8(np.median(self.rest)), self.rest))

    @cached_property
    def unmasked(self) -> Bool[np.ndarray, 'h w']:
        """Parts that should be gel but look covered."""
        return np.asarray(looks_covered(self.rest, self.dots) & self.gel)

    @cached_property
    def marked(self) -> Bool[np.ndarray, ' regions']:
        """Regions with a pattern that allows motion to be measured."""
        return np.asarray(self._confidence >= MEASURED)

    @cached_property
    def _confidence(self) -> Float[np.ndarray, ' regions']:
        """Confidence in each region's motion, measured in the rest image; 0 if there are no dots to track."""
        try:
            flow = self._flow(self.rest)
        except ImageError:
            return np.zeros(self.regions.count)
        return np.asarray(flow.displacement(self.rest).confidence, float).ravel()

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """All findings, in the order in which to correct them. A black picture shows nothing but that."""
        size = size_finding(self.sensor.image, len(self.pictures), dots=self.sensor.pattern.kind == 'dots')
        first = size, Finding('frame', OK, f'{self.sensor.frame}'), self._light()
        if self._dark:
            return first
        seen = *self._pattern(), self._focus(), self._shown(), self._measurable(), self._mask(), self._rest()
        return *first, *(each for each in seen if each is not None)

    @property
    def usable(self) -> bool:
        """Whether no finding is bad."""
        return all(each.level != BAD for each in self.findings)

    @property
    def _dark(self) -> bool:
        return any(picture_faults(each).dark for each in self.pictures)

    def _light(self) -> Finding:
        faults = [picture_faults(each) for each in self.pictures]
        bright = float(np.percentile(self.rest, 99))
        burnt = float((self.rest[self.gel] == 255).mean()) if self.gel.any() else 0.0
        levels = [each.level for each in faults]
        flicker = max(levels) / max(min(levels), 1.0) - 1
        text = f'brightest parts at {bright:.0f} of 255, {percent(burnt)} of the gel overexposed'
        if self._dark:
            text += '; an image is black and shows nothing else: switch on the light or uncover the lens'
            return Finding('light', BAD, text)
        if any(each.saturated for each in faults):
            return Finding('light', BAD, f'{text}; lower the exposure, the gain or the light')
        if bright < DIM_GREY:
            return Finding('light', LOOK, f'{text}; raise the exposure or the light')
        if burnt > BURNT_SHARE:
            return Finding('light', LOOK, f'{text}; lower the exposure, or mask reflecting parts')
        if flicker > FLICKER:
            text += f'; it differs by {percent(flicker)} between images: set exposure and gain to fixed values'
            return Finding('light', LOOK, text)
        return Finding('light', OK, text)

    def _pattern(self) -> Sequence[Finding]:
        if self.sensor.pattern.kind == 'dots':
            return dot_findings(self.regions.view, self.dots, len(self.expected_dots))
        if self.dots is not None:
            return (not_random(self.regions.view, self.dots),)
        inside = self._per_region(self._markers.peaks)[self.regions.usable]
        return (self._markers.pattern(int(np.median(inside)) if inside.size else 0),)

    @cached_property
    def _markers(self) -> Markers:
        return Markers(self.regions.view, self.rest, self.gel, beside(self._within) & ~self.sensor.covered)

    @cached_property
    def expected_dots(self) -> Float[np.ndarray, 'dots 2']:
        """Positions of the described dots whose whole disc is in the picture and uncovered."""
        return described_dots(self.regions.view)

    def _focus(self) -> Finding | None:
        if self.sensor.pattern.kind == 'spheres':
            return self._markers.focus() if self.gel.any() else None
        if self.dots is None:
            return None
        text = f'edges of dots have a blur of {self.dots.edge_px:.1f} px (standard deviation)'
        if self.dots.edge_px < LEAST_EDGE_PX:
            return Finding('focus', OK, text)
        return Finding('focus', LOOK, f'{text}; turn the lens until the edges are sharpest')

    def _shown(self) -> Finding:
        """How much of the gel is visible, and whether the pattern extends beyond the gel's rim."""
        share = self._shown_share
        gel = self.sensor.gel
        text = f'{percent(share)} of the described gel of {gel.width_mm:g} x {gel.height_mm:g} mm are visible'
        if self.sensor.pattern.kind == 'spheres' and self.dots is None and (more := self._markers.beyond()):
            return Finding('gel', BAD if self._markers.much_beyond else LOOK, f'{text}, and {more}')
        if share < LITTLE_SEEN:
            text += ': check gel.width_mm and height_mm, camera.position_mm and its focal length'
            return Finding('gel', BAD if share < HARDLY_SEEN else LOOK, text)
        return Finding('gel', OK, text)

    @property
    def _shown_share(self) -> float:
        """Share of the described gel that is in the picture and uncovered."""
        gel = self.sensor.gel
        places = gel.outline.lattice_mm(max(gel.width_mm, gel.height_mm) / PLACES, (0.0, 0.0))
        u, v = np.rint(self.regions.view.below_seen_at(places, gel.markers_mm[0])).T
        height, width = self.rest.shape
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        covered = self.sensor.covered[v[inside].astype(int), u[inside].astype(int)]
        return float((~covered).sum() / len(places))

    def _measurable(self) -> Finding:
        usable = self.regions.usable
        share = float(self.marked[usable].mean()) if usable.any() else 0.0
        sure = float(np.median(self._confidence[usable])) if usable.any() else 0.0
        text = (
            f'{usable.sum()} of {usable.size} see only the gel, {percent(share)} of them a pattern that can be '
            f'measured (confidence {sure:.2f}, median)'
        )
        if share < MARKED or self._measured.mean() < LEAST_SEEN:
            text += (
                '; that is too little to estimate forces: a gel without marks shows no motion, so print dots or spray '
                'speckle on it; if it has marks, check light, focus and mask'
            )
            return Finding('regions', BAD, text)
        if refused := self._refused():
            return Finding('regions', BAD, f'{text}; {refused}')
        if share < MOST_MARKED or sure < 0.5:
            return Finding('regions', LOOK, f'{text}; more contrast would help: light, exposure, focus')
        return Finding('regions', OK, text)

    def _refused(self) -> str:
        """Why a live node would refuse this rest image; empty if it would accept it."""
        try:
            weighed = {'texture_grey': NO_TEXTURE} if self.sensor.pattern.kind == 'dots' else {}
            options = RegionOptions(self.regions.rows, self.regions.cols, **weighed)
            require_rest_image(self.rest, texture_confidence(self.rest, options))
        except ImageError as error:
            return str(error)
        return ''

    def _mask(self) -> Finding:
        covered, more = float(self.sensor.covered.mean()), float(self.unmasked.mean())
        text = f'the mask covers {percent(covered)} of the image'
        if more > UNMASKED:
            text += f', and {percent(more)} more look covered (red in the figure): mask them'
        return Finding('mask', LOOK if more > UNMASKED else OK, text)

    def _rest(self) -> Finding | None:
        """Motion between pictures in which nothing touches."""
        usable = self._measured
        if len(self.pictures) < 2 or not usable.any():
            return None
        noise_px = self.noise_px[usable]
        middle, most = float(np.median(noise_px)), float(np.percentile(noise_px, 95))
        text = (
            f'regions seem to move by {middle:.3f} px (median; 95 % less than {most:.3f}) from image to image, '
            f'which is {1000 * middle / self.regions.view.px_per_mm:.1f} um on the gel'
        )
        first, still = self._alike
        if not still.all():
            return Finding('noise', LOOK, f'{text}; {self._touched(still)}')
        if middle < UNSTEADY_PX and self._apart_px[first].max() < UNEVEN_PX:
            return Finding('noise', OK, text)
        return Finding('noise', LOOK, f'{text}: something touches or moves, or the light flickers')

    def _touched(self, still: Bool[np.ndarray, ' pictures']) -> str:
        """Advice about pictures that differ. The pictures cannot show which of the two kinds is untouched."""
        others = np.flatnonzero(~still)
        return (
            f'{len(others)} of {len(still)} images, such as {self._names[others[0]]}, differ from the others by more '
            'than noise: something touches the gel in some, or compression changes them; give the untouched gel only'
        )

    @cached_property
    def noise_px(self) -> Float[np.ndarray, ' regions']:
        """Root mean square motion of each region between one picture and the others that are like it."""
        first, still = self._alike
        moved = self._motion_px[still & (np.arange(len(still)) != first)] - self._motion_px[first]
        return np.asarray(np.sqrt(np.square(moved).sum(axis=-1).mean(axis=0)), float)

    @cached_property
    def _motion_px(self) -> Float[np.ndarray, 'pictures regions 2']:
        """Motion relative to the first picture."""
        flow = self._flow(self.pictures[0])
        moved = [flow.displacement(each).displacement_px for each in self.pictures]
        return np.asarray(moved, float).reshape(len(moved), -1, 2)

    @cached_property
    def _apart_px(self) -> Float[np.ndarray, 'pictures pictures']:
        return apart_px(self._motion_px[:, self._measured])

    @cached_property
    def _alike(self) -> tuple[int, Bool[np.ndarray, ' pictures']]:
        return alike(self._apart_px)

    @property
    def _measured(self) -> Bool[np.ndarray, ' regions']:
        """Regions that see the gel and a pattern."""
        return np.asarray(self.regions.usable & self.marked)

    def _flow(self, rest: UInt8[np.ndarray, 'h w']) -> FlowMethod:
        """The flow method that models of described sensors use."""
        method = DotsFlow.name if self.sensor.pattern.kind == 'dots' else InverseCompositionalFlow.name
        flow = make_flow(method, {'rows': self.regions.rows, 'cols': self.regions.cols})
        flow.set_reference(rest)
        return flow

    def _per_region(self, on: Bool[np.ndarray, 'h w']) -> Float[np.ndarray, ' regions']:
        """Number of set pixels in each region."""
        rows, cols = self.regions.rows, self.regions.cols
        height, width = on.shape
        counted: np.ndarray = on.reshape(rows, height // rows, cols, width // cols).sum(axis=(1, 3))
        return counted.ravel().astype(float)


def outline_px(regions: Regions) -> Float[np.ndarray, 'corners 2']:
    """The gel's rim in the picture, at the depth where the pattern begins."""
    gel = regions.sensor.gel
    return regions.view.below_seen_at(gel.outline.rim_mm(), gel.markers_mm[0])


def size_finding(image: ImageSettings, count: int, *, dots: bool) -> Finding:
    """The size of so many images, and whether the motion of a texture can be followed in them."""
    width, height = image.crop_px
    text = f'{count} image{"s" * (count > 1)} of {image.width}x{image.height}, of which {width}x{height} are used'
    if dots or max(width, height) <= MOST_PX:
        return Finding('size', OK, text)
    return Finding(
        'size', LOOK, f'{text}; in such large images motion is underestimated: scale all images down, to about 640x480'
    )
