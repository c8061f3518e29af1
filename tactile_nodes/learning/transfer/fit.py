"""Calibrate a model for another gel from a few presses, with no more parameters than these support.

The motion around a press is similar in any soft layer, so the known gel's profiles serve the other gel. Two forms are
fitted, the simpler first. The first changes the gel as a whole (hardness, thickness, camera). The second adds each
region's own place and couplings, with the scatter of the known gel's regions as prior. Each form is judged on presses
that its fit did not see.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.axisymmetric.calibration import Judged
from tactile_nodes.learning.axisymmetric.local import with_local
from tactile_nodes.learning.axisymmetric.regions import (
    FIRST_DOUBT,
    Presses,
    Shared,
    measured_doubt,
    shared_of,
    views,
)
from tactile_nodes.learning.axisymmetric.unsure import with_unsure
from tactile_nodes.learning.datasets.holds import still_holds
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.fit import LEAST_UNTOUCHED, rest_and_gain
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.calibration import calibration_of
from tactile_nodes.learning.transfer.checks import (
    MOST_OFFSET_N,
    require_motion,
    require_presses,
    require_tared,
    require_unit,
)
from tactile_nodes.learning.transfer.errors import Errors, Point
from tactile_nodes.learning.transfer.judgement import ADVICE, objection, of_the_mean, require_worth
from tactile_nodes.learning.transfer.mounting import gives_way_px, in_words
from tactile_nodes.learning.transfer.regions import Smooth, fit_with_smooth
from tactile_nodes.learning.transfer.whole import SIZES, Typical, WholeFit, fit_whole
from tactile_nodes.sensing.explain.arrays import AnyReadout
from tactile_nodes.sensing.explain.axisymmetric.by_sides import BySides
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.camera import camera_terms
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.shapes import Float, Int

FORMS = 'whole', 'regions'
REGION_TURNS = 4
SHARED_SIGMA = np.array([0.2, 0.03, 0.0, 0.0])
"""Prior of the logarithms of softness and width in fits of regions, around the whole-gel fit: markers bias them.
Radial smear is that of the known gel."""
LEAST_DOUBT = 0.02
"""Relative error of a region's motion in fits of regions, because the known gel's profiles are not exact here."""
IN_GAPS = 0.65
"""Factor on the errors under held-out presses, which are too large because each lies in the gap that it leaves."""
FOLDS = 5
WORTH = 1.02
"""The simpler form is chosen if its held-out misfit is at most this times the best."""


@dataclass(frozen=True)
class Transfer:
    """A calibrated readout, and how it was found.

    `misfits` are by form: RMS of the residuals of held-out presses, in units of their expected standard deviation.
    `field` says how the force field was fitted, if the model has one. `curve` is the learning curve, if it was asked
    for. `objection` is why the calibration should not be used, if it was forced. `whole` are the numbers by which
    the gel differs as a whole, see `tactile_nodes.learning.transfer.whole.SIZES`. `gives_px` is the motion of the
    picture per newton if the mounting of the camera gives way under the force, see `mounting.gives_way_px`.
    """

    readout: AxisymmetricReadout | FieldReadout
    form: str
    misfits: Mapping[str, float]
    before: Errors
    after: Errors
    presses: int
    force_offset_n: float
    whole: Mapping[str, float]
    objection: str = ''
    field: str = ''
    curve: tuple[Point, ...] = ()
    gives_px: float = 0.0

    @property
    def reason(self) -> str:
        """Why this form was chosen, in a sentence."""
        return reason_of_form(self.form, self.misfits)

    @property
    def mounting(self) -> str:
        """What the presses say of the camera's mounting, in a sentence; empty if it holds."""
        # Only the fit of a field tells sides from a mounting, and only it knows wide bodies.
        other, page = (
            ('the body is wide', 'calibration') if self.field else ('the sides of the gel are free', 'sensors')
        )
        return in_words(self.gives_px, f'{other} (docs/{page}.md)')

    def as_dict(self) -> dict[str, Any]:
        """The entry in the model card."""
        plain = asdict(replace(self, readout=None, curve=()))  # type: ignore[arg-type]
        plain |= {'before': self.before.as_dict(), 'after': self.after.as_dict(), 'reason': self.reason}
        return {name: value for name, value in plain.items() if name not in ('readout', 'curve')}


def transfer(
    known: AxisymmetricReadout,
    dataset: Dataset,
    progress: Progress | None = None,
    *,
    forced: bool = False,
    sides: BySides | None = None,
) -> Transfer:
    """The readout for the gel of a data set, from that of a `known` gel.

    `forced` also accepts a readout that is no better on held-out presses than the known one, or than their mean.
    `sides` is what the sides of the gel add to all regions.

    Raises:
        DatasetError: the presses do not suffice, or the calibrated readout would be no better than that.
    """
    progress = progress or Progress()
    require_presses(dataset, reached_mm(known))
    other = OtherGel.of(known, dataset, sides)
    with progress.bar('comparing forms', 2 + len(FORMS)) as bar:
        whole = other.whole()
        if gives_px := other.gives_px(whole.response):
            other = other.with_moving_camera()
            whole = other.whole()
            gives_px = other.gives_px(whole.response)
        require_unit(whole.softness, forced=forced)
        fold = folds_of(other.presses.contacts)
        offset = other.offset(whole)
        require_tared(offset, other.offset_spread(whole, fold) if abs(offset) > MOST_OFFSET_N else 0.0)
        bar.advance()
        folds = other.folds(whole, fold, bar.advance)
        misfits = {form: other.misfit(fitted, fold) for form, fitted in folds.items()}
        form = next(name for name in FORMS if misfits[name] <= WORTH * min(misfits.values()))
        doubt = other.doubt(folds[form], fold)
        response = whole.response if form == 'whole' else other.regions(whole.response)
        readout = other.locally(other.readout(response, doubt, form))
        held = [
            Judged.of(
                other.locally(other.readout(fitted, doubt, form), np.flatnonzero(fold != number)),
                dataset, other.rows[fold == number],
            )
            for number, fitted in zip(np.unique(fold), folds[form], strict=True)
        ]  # fmt: skip
        bar.advance()
    held = [each for each in held if each.fits]
    if not held:
        raise DatasetError('no press shows enough regions; check the camera and the light')
    read = live_errors(known, dataset, other.rows)
    before = Errors.of(read[np.isfinite(read).all(axis=1)])
    after = Errors.of(np.concatenate([each.errors for each in held]))
    fault = objection('calibration', after, before, of_the_mean(other.presses.contacts))
    require_worth(fault, ADVICE, forced=forced)
    readout = replace(readout, calibration=calibration_of(readout, held, dataset, other.untouched))
    numbers = {name: float(value) for name, value in zip(SIZES, whole.numbers, strict=True)}
    return Transfer(
        readout, form, misfits, before, after, len(other.presses), offset, numbers, fault, gives_px=gives_px
    )  # fmt: skip


def reached_mm(known: AxisymmetricReadout) -> tuple[float, float]:
    """The span of the presses on the known gel along x and along y."""
    return 2 * known.correction.reach_mm, 2 * known.correction.reach_mm


def pressed_gel(
    known: InputScaling, dataset: Dataset
) -> tuple[InputScaling, list[Int[np.ndarray, ' pictures']], Int[np.ndarray, ' presses']]:
    """Regions, holds and presses of another gel.

    The regions are those that show markers on it, whether or not they did on the known gel. Then follow the images
    of each hold, and one image of each.

    Raises:
        DatasetError: regions are too few, or their motion is no number.
    """
    scaling = _scaling_of(known, dataset)
    require_motion(dataset, scaling)
    holds = still_holds(dataset, np.flatnonzero(dataset.presses[:, 2] > 0), scaling.trusted)
    return scaling, holds, np.array([each[0] for each in holds])


def at_rest(scaling: InputScaling) -> InputScaling:
    """Scaling for future images, which are measured against another rest image.

    Noise in the rest image of these presses is not shared by other rest images.
    """
    return replace(scaling, mean=np.zeros_like(scaling.mean))


@dataclass(frozen=True)
class OtherGel:
    """Presses on another gel, and what is expected of its regions before any press is used.

    `presses` are means over the images of each hold, for the fit. `rows` has one image of each hold, for the
    evaluation, because a model estimates from single images.
    """

    source: AxisymmetricReadout
    scaling: InputScaling
    presses: Presses
    rows: np.ndarray
    untouched: np.ndarray
    typical: Typical
    view: Float[np.ndarray, 'regions 2']
    pictures: Int[np.ndarray, ' presses']
    sides: BySides | None = None

    @classmethod
    def of(cls, source: AxisymmetricReadout, dataset: Dataset, sides: BySides | None = None) -> OtherGel:
        """Raises the errors of `pressed_gel`."""
        scaling, holds, rows = pressed_gel(source.scaling, dataset)
        untouched = np.flatnonzero(~(dataset.presses[:, 2] > 0))
        typical = Typical.of(source.response, views(source.scaling.trusted))
        presses = Presses.of_holds(dataset, holds, scaling)
        pictures = np.array([len(each) for each in holds])
        if sides is not None:
            sides = sides.of_regions(np.flatnonzero(scaling.trusted.reshape(-1) > 0))
        return cls(source, scaling, presses, rows, untouched, typical, views(scaling.trusted), pictures, sides)

    @property
    def start(self) -> AxisymmetricResponse:
        return replace(self.typical.at(self.view), sides=self.sides)

    @property
    def live_scaling(self) -> InputScaling:
        """See `at_rest`."""
        return at_rest(self.scaling)

    @property
    def pressed_n(self) -> float:
        """The force of the hardest press."""
        return float(self.presses.contacts[:, 2].max())

    def whole(self) -> WholeFit:
        """The fit of the gel as a whole to all presses."""
        return fit_whole(self.start, self.presses)

    def gives_px(self, response: AxisymmetricResponse) -> float:
        """See `gives_way_px`."""
        presses, predicted = self.presses, response.motion(self.presses.contacts)
        weight = presses.weights(response, FIRST_DOUBT, predicted)
        return gives_way_px(self.camera, presses.motion - predicted, np.square(weight), presses.contacts[:, 2])

    def with_moving_camera(self) -> OtherGel:
        """The same gel, with the motion of the camera to be found for each press."""
        return replace(self, presses=replace(self.presses, camera=self.camera))

    @property
    def camera(self) -> Float[np.ndarray, 'terms motions']:
        """See `camera_terms`."""
        return camera_terms(self.scaling.trusted.shape, np.flatnonzero(self.scaling.trusted.reshape(-1) > 0))

    def offset(self, whole: WholeFit, chosen: np.ndarray | slice = slice(None)) -> float:
        """The offset of the forces (N), estimated from some presses or all."""
        return fit_whole(self.start, self.presses.take(chosen), begin=whole.numbers, offset=True).offset_n

    def offset_spread(self, whole: WholeFit, fold: Int[np.ndarray, ' presses']) -> float:
        """The standard deviation of that offset, by leaving out each fold (jackknife)."""
        found = np.array([self.offset(whole, np.flatnonzero(fold != number)) for number in np.unique(fold)])
        return float(np.sqrt((len(found) - 1) * found.var()))

    def folds(
        self, whole: WholeFit, fold: Int[np.ndarray, ' presses'], advance: Callable[[int, str], object]
    ) -> dict[str, list[AxisymmetricResponse]]:
        """Each form, fitted once per fold to the presses of all other folds."""
        rest = [np.flatnonzero(fold != number) for number in np.unique(fold)]
        fits = [fit_whole(self.start, self.presses.take(each), begin=whole.numbers) for each in rest]
        advance(1, 'whole')
        regions = [self.regions(fit.response, each) for fit, each in zip(fits, rest, strict=True)]
        advance(1, 'regions')
        return {'whole': [each.response for each in fits], 'regions': regions}

    def regions(self, response: AxisymmetricResponse, chosen: np.ndarray | None = None) -> AxisymmetricResponse:
        """The response with every region's own numbers, fitted to some presses or all."""
        presses = self.presses if chosen is None else self.presses.take(chosen)
        precision, smooth = self.typical.precision(self.view), Smooth.of(response, self.typical, self.view)
        shared = Shared(shared_of(response), SHARED_SIGMA)
        # Far from a press the profiles are exact to a percent. A larger error would leave regions to their prior.
        doubt = np.maximum(self.source.doubt, LEAST_DOUBT)
        for _ in range(REGION_TURNS):
            still = presses.still(response, doubt)
            response, smooth = fit_with_smooth(response, still, smooth, precision, doubt, shared)
        return with_unsure(response, presses, precision, doubt)

    def misfit(self, folds: list[AxisymmetricResponse], fold: np.ndarray) -> float:
        """RMS of the residuals of held-out presses, in units of their expected standard deviation."""
        squares = []
        for number, response in zip(np.unique(fold), folds, strict=True):
            out = self.presses.take(np.flatnonzero(fold == number))
            weight = self._weights(out)
            squares.append(np.square(out.left(response.motion(out.contacts), weight) * weight).ravel())
        return float(np.sqrt(np.mean(np.concatenate(squares))))

    @staticmethod
    def _weights(presses: Presses) -> np.ndarray:
        """Weights that are the same for every form: from noise, and a tenth of the measured motion."""
        size = np.square(presses.motion).sum(axis=-1, keepdims=True)
        return np.asarray(np.sqrt(presses.certainty / (1 + presses.certainty * 0.01 * size)))

    def doubt(
        self, folds: list[AxisymmetricResponse], fold: Int[np.ndarray, ' presses']
    ) -> Float[np.ndarray, ' distances']:
        """The relative errors of the regions' motion, measured on held-out presses."""
        shares = [
            measured_doubt(response, self.presses.take(np.flatnonzero(fold == number)))
            for number, response in zip(np.unique(fold), folds, strict=True)
        ]
        return np.asarray(IN_GAPS * np.sqrt(np.mean(np.square(shares), axis=0)))

    def readout(
        self, response: AxisymmetricResponse, doubt: Float[np.ndarray, ' distances'], form: str = 'regions'
    ) -> AxisymmetricReadout:
        """The source's readout with another response, and a correction of the typical errors of such calibrations.

        Where none was measured, the source's own one serves for places, since their errors are due to the
        lens. Its effect on forces follows from the source's own markers.
        """
        source, presses = self.source, len(self.presses)
        terms = source.correction.terms * np.array([1.0, 1.0, 0.0])
        if source.prior is not None and form == 'regions':
            terms = source.prior.after(presses)
        correction = replace(source.correction, terms=terms, local=None)
        return replace(
            source, scaling=self.live_scaling, response=response, doubt=doubt, correction=correction, prior=None,
            pressed_n=self.pressed_n,
        )  # fmt: skip

    def locally(self, readout: AxisymmetricReadout, chosen: np.ndarray | slice = slice(None)) -> AxisymmetricReadout:
        """The readout, corrected for its local errors at some of the presses it was fitted to, or all."""
        return with_local(readout, self.presses.take(chosen), self.pictures[chosen])


def _scaling_of(source: InputScaling, dataset: Dataset) -> InputScaling:
    """The other gel's own rest and noise if it has enough images without contact, otherwise those of the source."""
    untouched = dataset.presses[:, 2] <= 0
    trusted = np.asarray(dataset.trusted(0.5), np.float32)
    if untouched.sum() < LEAST_UNTOUCHED:
        return replace(source, trusted=trusted * source.trusted)
    mean, gain = rest_and_gain(dataset, np.flatnonzero(untouched), trusted)
    return replace(source, mean=mean, gain=gain, trusted=trusted)


def reason_of_form(form: str, misfits: Mapping[str, float]) -> str:
    """Why this form was chosen: 'whole: regions leaves no more than 2 % less …'; the form alone without presses."""
    if len(misfits) < 2:
        return f'{form}: too few presses to try another' if misfits else form
    best = min(misfits, key=lambda name: misfits[name])
    if best == form:
        return f'{form}: no other form has a smaller residual on held-out presses'
    if misfits[form] > WORTH * misfits[best]:
        return f'{form}: its errors on held-out presses are (nearly) the smallest, though {best} has a smaller residual'
    return f'{form}: the residual of {best} on held-out presses is at most {100 * (WORTH - 1):.0f} % smaller'


def folds_of(presses: Float[np.ndarray, 'n 3']) -> np.ndarray:
    """A fold number of 0 to 4 for each press; presses at one place share it."""
    _, first, place = np.unique(np.round(presses[:, :2], 3), axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    fold: np.ndarray = rank[place.reshape(-1)] % FOLDS
    return fold


def live_errors(readout: AnyReadout, dataset: Dataset, rows: np.ndarray) -> Float[np.ndarray, 'n 3']:
    """Errors of x, y (mm) and force (N) as the live node would estimate; NaN if unknown or if no estimate is made."""
    errors = []
    for row in rows.tolist():
        found = readout.read(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        x, y, _, force_n = dataset.presses[row].tolist()
        errors.append((found.contacts[0].x_mm - x, found.contacts[0].y_mm - y, found.normal_force_n.sum() - force_n))
    return np.reshape(errors, (-1, 3)).astype(float)
