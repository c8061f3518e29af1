"""The response of a sensor's regions to forces on its surface: from its description, and from presses of a known body.

The description leaves few numbers open. They are one for the whole gel (its modulus), or fifteen for each region: the
depths of its markers and where its rays meet the gel (see `tactile_nodes.sensing.elasticity.regions`). Three forms
are fitted, the simplest first: the description alone, one gain, regions. Held-out presses decide between them
(`judging`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import Bodies
from tactile_nodes.learning.field.camera import SCALES, fitted_camera, focal_objection, in_words, looked_otherwise
from tactile_nodes.learning.field.judging import ROOM, UNFITTED, Chosen, Judge, passes_of, response_of, spread_of
from tactile_nodes.learning.field.presses import (
    STEP,
    AllPressures,
    BodyPresses,
    known_of,
    noise_px,
    nominal,
    presses_of,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.errors import UNKNOWN, Errors, Point
from tactile_nodes.sensing.elasticity.region_choice import LEAST_SEEN, usual_regions
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.explain.camera import STILL, camera_terms
from tactile_nodes.sensing.explain.field.readout import LEAST_REGIONS, FieldReadout
from tactile_nodes.sensing.explain.field.refinement import Refinement
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, Int

KNOWN_CONFIDENCE = 0.1
"""Confidence from which a region counts."""

DOTS_NOISE_PX = 0.012
"""Least error of the motion of a printed dot, as in a picture with noise of two grey levels. With less, as rest images
averaged over many frames give it, light presses between dots would be read too badly for a calibration (`pytest
test/learning/field/test_several_bodies.py -k light`)."""

CURVE = 0, 10, 30, 100
"""Numbers of presses at which the error is reported, as far as there are so many."""

UNEXPLAINED, BY_SIDES = 1.1, 0.9
"""Residual of held-out presses, in units of the expected one, beyond which a gel may have sides that its description
ignores; and the share of it that sides must leave."""

UNPLACED_MM = 0.15
"""Least error of a place (standard deviation along an axis) that no press has measured."""

NEARLY = 0.9
"""This share of all presses counts as all."""


@dataclass(frozen=True)
class FieldFit:
    """A readout, and how it was found; `misfits` by form are RMS residuals of held-out presses.

    `by` are the presses. `errors` are of held-out ones, estimated by the field alone; `curve` has those with fewer
    presses. `offset_n` is the offset of their forces, and its standard deviation. `left_out` is the number of
    presses that were too deep for the linear layer. `looks` is how the camera differs from its description, as in
    `camera.looking`. `gives_px` is as in `Transfer`. `sides` is what the sides of the gel add to all regions;
    `found_sides` are these if the presses show them and the description does not.
    """

    readout: FieldReadout
    form: str
    gain: float = 1.0
    by: BodyPresses | None = None
    misfits: Mapping[str, float] = field(default_factory=dict)
    errors: Errors = UNKNOWN
    curve: tuple[Point, ...] = ()
    offset_n: tuple[float, float] = (0.0, 0.0)
    left_out: int = 0
    looks: Float[np.ndarray, ' numbers'] = field(default_factory=lambda: np.zeros(len(SCALES)))
    gives_px: float = 0.0
    sides: BySides | None = None
    found_sides: str = ''

    @property
    def presses(self) -> int:
        """The number of presses in the fit."""
        return 0 if self.by is None else len(self.by)

    @property
    def reason(self) -> str:
        """Why this form was chosen, in a sentence."""
        if not self.misfits:
            return f'{self.form}: no press gives more information'
        left = ', '.join(f'{name} {value:.2f}' for name, value in self.misfits.items())
        return (
            f'{self.form}: the residual of held-out presses is {left} times the expected one'
            f'{in_words(self.looks)}{self.told_sides}{self.deep}'
        )

    @property
    def misfit(self) -> float:
        """The residual of held-out presses in the form that explains them best."""
        return min(self.misfits.values())

    @property
    def told_sides(self) -> str:
        """What the presses show of the sides of the gel, in words."""
        if not self.found_sides:
            return ''
        return (
            f'; according to the presses the sides of the gel are {self.found_sides}: write gel.sides: '
            f'{self.found_sides} into its description'
        )

    @property
    def objection(self) -> str:
        """The objection to the fit, whatever its errors; empty if there is none."""
        return focal_objection(self.looks)

    @property
    def deep(self) -> str:
        """The number of presses that were left out, in words."""
        return f'; presses left out, too deep (press lighter): {self.left_out}' if self.left_out else ''


def noise_of_dots(sensor: Sensor, scaling: InputScaling) -> InputScaling:
    """The scaling of a sensor with at least the noise of printed dots, if it has such."""
    if sensor.pattern.kind != 'dots':
        return scaling
    return replace(scaling, gain=np.minimum(scaling.gain, np.float32(1 / DOTS_NOISE_PX)))


def scaling_of(sensor: Sensor, gain: float, shape: tuple[int, ...] = ()) -> InputScaling:
    """The regions of a described sensor: those that see only gel are known; `gain` is the inverse of their noise (px).

    They are the usual ones, or of a `shape`: rows and columns.

    Raises:
        ConfigurationError: hardly any region sees the gel, or the image cannot be divided into regions.
    """
    regions = Regions(sensor, *shape) if shape else usual_regions(sensor)
    trusted = regions.usable.reshape(regions.rows, regions.cols)
    if trusted.mean() < LEAST_SEEN:
        raise ConfigurationError(
            f'{trusted.sum()} of the {trusted.size} regions of the image of {sensor.name} see its gel; check '
            'camera.position_mm, camera.tilt_deg and its focal length, gel.width_mm, gel.height_mm and mask, or give '
            'more bins.rows and bins.cols, as few bins give few and wide regions'
        )
    if trusted.sum() < LEAST_REGIONS:
        raise ConfigurationError(
            f'only {trusted.sum()} regions of the image of {sensor.name} see its gel, and {LEAST_REGIONS} are needed '
            'to estimate a force; use a larger image.crop, more bins, or a pattern with more dots'
        )
    axes = (*trusted.shape, 2)
    return InputScaling(
        np.zeros(axes, np.float32), np.full(axes, gain, np.float32), trusted.astype(np.float32), KNOWN_CONFIDENCE
    )


def uncovered(sensor: Sensor, scaling: InputScaling) -> InputScaling:
    """A scaling without the regions that the sensor's mask covers, or that look beyond the rim of a shaped gel.

    Raises:
        ConfigurationError: hardly any is left.
    """
    regions, shaped = regions_of(sensor, scaling), sensor.gel.outline_mm or sensor.gel.dome_radius_mm
    covered = (~regions.usable if shaped else regions.covered).reshape(scaling.trusted.shape)
    if not covered.any():
        return scaling
    trusted = np.where(covered, np.float32(0), scaling.trusted)
    if (trusted > 0).mean() < LEAST_SEEN:
        raise ConfigurationError(
            f'mask and rim of {sensor.name} leave {(trusted > 0).sum()} of {trusted.size} regions of its image, too '
            'few to estimate a force; cover less'
        )
    return replace(scaling, trusted=trusted)


def described(
    sensor: Sensor, scaling: InputScaling, progress: Progress | None = None, refinement: Refinement | None = None
) -> FieldFit:
    """The readout from a description alone; `scaling` says which regions are known, and their features at rest.

    `refinement` is as in `fit_field`.
    """
    regions = regions_of(sensor, scaling)
    with (progress or Progress()).bar('response of the regions', 1) as bar:
        # Slopes count nothing until presses say otherwise.
        terms = regions.terms_of_patches(known_of(scaling), slopes=False)
        response = response_of(terms, nominal(regions, scaling)[:, ::3])
        bar.advance()
    readout = FieldReadout(
        scaling, response, regions.bins, noise_px(scaling), UNFITTED, misfit_limit=ROOM,
        surface=regions.surface_under_shear, passes=passes_of(regions),
    )  # fmt: skip
    return FieldFit(as_described(readout, sensor, refinement), 'description')


def as_described(readout: FieldReadout, sensor: Sensor, refinement: Refinement | None) -> FieldReadout:
    """A readout that follows from a description alone, with this refinement, and with the uncertainty of its forces.

    Their relative error is also that of the moduli, which an image does not show.
    """
    spread = spread_of('', 0, regions_of(sensor, readout.scaling), refinement)
    spread = replace(spread, response=math.hypot(spread.response, sensor.gel.moduli_off)).placed(UNPLACED_MM)
    return replace(readout, spread=spread, refinement=refinement)


def fit_field(
    sensor: Sensor,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' rows'],
    fold: Int[np.ndarray, ' rows'],
    bodies: Bodies,
    progress: Progress | None = None,
    *,
    curve: bool = False,
    refinement: Refinement | None = None,
) -> FieldFit:
    """The readout fitted to presses of known bodies, in the form that they support.

    Args:
        sensor: its description.
        scaling: which regions are known, and what they show at rest.
        dataset: holds the presses.
        rows: samples with contact, an image of each press.
        fold: the fold of each press; each fold is held out once.
        bodies: the body that pressed in each sample of the data set.
        progress: shows the progress.
        curve: whether to report errors with fewer presses.
        refinement: what the readout refines its forces with.

    Raises:
        DatasetError: none of these presses has a force that is known.
        ConfigurationError: a body is wider than the gel.
    """
    scaling = noise_of_dots(sensor, scaling)

    def fitted(sides: str) -> FieldFit:
        gel = replace(sensor.gel, sides=sides)
        return _fit_described(
            replace(sensor, gel=gel), scaling, dataset, rows, fold, bodies, progress or Progress(), refinement,
            curve=curve,
        )  # fmt: skip

    fit = fitted(sensor.gel.sides)
    if sensor.gel.sides != 'ignored' or not sensor.gel.may_have_sides or fit.misfit < UNEXPLAINED or fit.objection:
        return fit
    for sides in ('free', 'held'):  # one softens the gel, the other stiffens it: at most one explains more
        tried = fitted(sides)
        if tried.misfit <= BY_SIDES * fit.misfit:
            return replace(tried, found_sides=sides)
    return fit


def _fit_described(
    sensor: Sensor,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' rows'],
    fold: Int[np.ndarray, ' rows'],
    bodies: Bodies,
    progress: Progress,
    refinement: Refinement | None,
    *,
    curve: bool,
) -> FieldFit:
    """The fit for a gel with sides as described."""
    regions = regions_of(sensor, scaling)
    pressures = AllPressures(regions, bodies)
    linear = pressures.linear(rows, dataset.presses[rows][:, 3].astype(float))
    too_deep, chosen = len(rows) - len(linear), linear[pressures.few(rows[linear])]
    rows, fold = rows[chosen], fold[chosen]
    with progress.bar('fitting the force field', len(rows) + 4) as bar:
        regions, presses, gives_px = _seen(regions, pressures, scaling, dataset, rows, fold, bar.advance)
        start = nominal(regions, scaling)
        terms = regions.terms_of_patches(known_of(scaling))
        judge = Judge(terms, scaling, regions, dataset, bodies.is_a_ball, start, presses.softening, refinement)
        found = Chosen.of(judge, presses, fold)
        bar.advance(1, found.form)
        held = judge.read(found.form, presses, fold, found.held)
        points = _curve(judge, presses, fold) if curve else ()
        bar.advance()
    readout = judge.readout(found.form, found.shares, len(rows), ROOM * max(held.misfit, 1.0))
    readout = replace(readout, spread=readout.spread.placed(held.place_mm))
    offset = presses.offset_n(start, fold)
    return FieldFit(
        readout, found.form, found.gain, presses, found.misfits, held.errors, points, offset, too_deep,
        looked_otherwise(sensor, regions.sensor), gives_px, _by_sides(regions, scaling, found.shares),
    )  # fmt: skip


def _seen(
    regions: Regions,
    pressures: AllPressures,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' n'],
    fold: Int[np.ndarray, ' n'],
    advance: Callable[[int], object],
) -> tuple[Regions, BodyPresses, float]:
    """The regions with their camera fitted, the presses on them, and how far these move the picture (`gives_way_px`).

    The motion of the camera under the force is found only if the presses show it: it takes eight numbers for each.
    """
    presses = presses_of(regions, pressures, scaling, dataset, rows, advance=advance)
    gain = presses.gain(nominal(regions, scaling))
    softer = gain if gain > 0 and abs(math.log(gain)) > math.log(STEP) / 2 else 1.0
    found, gives_px, moving = regions, 0.0, camera_terms(scaling.trusted.shape, known_of(scaling))
    for camera, tell in ((STILL, advance), (moving, lambda _: None)):
        sensor = fitted_camera(regions, pressures, scaling, dataset, rows, fold, softer, camera, tell)
        found = regions if sensor == regions.sensor else regions_of(sensor, scaling)
        if sensor.gel != regions.sensor.gel:
            pressures = AllPressures(found, pressures.bodies)
        if found is not regions or softer != 1 or len(camera):
            presses = presses_of(found, pressures, scaling, dataset, rows, softer, camera=camera)
        gives_px = presses.gives_px(nominal(found, scaling), moving)
        if not gives_px:
            break
    return found, presses, gives_px


def _by_sides(regions: Regions, scaling: InputScaling, shares: Float[np.ndarray, 'regions terms']) -> BySides | None:
    """What the sides of the gel add to all regions, with these shares of the terms of the known ones."""
    known = known_of(scaling)
    if (terms := regions.terms_by_sides(known)) is None:
        return None
    per_n = np.zeros((regions.patches.count, regions.count, 2), np.float32)
    per_n[:, known] = np.einsum('rptk,rt->krp', terms, shares.astype(np.float32), optimize=True)
    return BySides(regions.patches, per_n)


def regions_of(sensor: Sensor, scaling: InputScaling) -> Regions:
    """The regions of a sensor's image that a scaling knows."""
    return Regions(sensor, *scaling.trusted.shape)


def _curve(judge: Judge, presses: BodyPresses, fold: Int[np.ndarray, ' n']) -> tuple[Point, ...]:
    """Errors of held-out presses, by fits to the first few of the others, and to all of them."""
    rest = [np.flatnonzero(fold != out) for out in np.unique(fold)]
    most = min(map(len, rest))
    points = []
    for count in sorted({*(n for n in CURVE if n < NEARLY * most), most}):
        chosen = [_few(judge, presses.take(each[:count]), fold[each[:count]]) for each in rest]
        form = Counter(name for name, _ in chosen).most_common(1)[0][0]
        held = dict(zip(np.unique(fold).tolist(), [shares for _, shares in chosen], strict=True))
        points.append(Point(count, form, judge.read(form, presses, fold, held).errors))
    return tuple(points)


def _few(judge: Judge, presses: BodyPresses, fold: Int[np.ndarray, ' n']) -> tuple[str, np.ndarray]:
    """The form that a few presses support, and the share of each term in it."""
    if len(np.unique(fold)) < 2:
        return 'description', judge.start
    chosen = Chosen.of(judge, presses, fold)
    return chosen.form, chosen.shares
