"""Calibrate a model for another gel without a rig: known weights put anywhere, a pen at known places, two rest images.

Weights say how hard the gel is, wherever they stand. Pens say where the regions look, however hard they press. The
outline of the gel in its rest image beside that of the known gel says roughly what pens say, and needs no press. What
nothing tells stays as it is on the known gel, and the result says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.axisymmetric.calibration import least_gain
from tactile_nodes.learning.axisymmetric.regions import FIRST_DOUBT, Presses, views
from tactile_nodes.learning.coverage import NORMAL_90
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.calibration import cautious
from tactile_nodes.learning.transfer.checks import LEAST_PRESSES
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.fit import WORTH, OtherGel, folds_of, live_errors, told_reason
from tactile_nodes.learning.transfer.partial_presses import PartialFit, at, fit_partial, located, unknown
from tactile_nodes.learning.transfer.whole import HARDNESS, SIZES, Typical
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.picture.outline import OutlineMap

LEAST_PLACES, REGIONS_FROM = 3, 8
"""Places that fix a linear map and a shift; presses from which the regions are tried one by one."""
REGION_TURNS = 10
"""More than where all of a press is known: regions and what is unknown of presses find each other bit by bit."""
ASIDE = 0.05
"""Of what a region scatters by: how far a term of what is typical of couplings is expected from where the whole fit has
it. Less than where all of a press is known, since presses that may move would follow."""
SEEN_OUTLINE = {
    'shift_x_mm': 0.3, 'shift_y_mm': 0.3, 'turn_xx': 0.03, 'turn_yx': 0.03, 'turn_xy': 0.03, 'turn_yy': 0.03,
    'roll': 0.03,
}  # fmt: skip
"""How far off an outline leaves the numbers that it tells: measured on three gels."""
SHIFT = ('shift_x_mm', 'shift_y_mm')
"""What presses at unknown places alone must not tell: streaks point to the middle of the picture, but faintly."""
UNTOLD_FORCE_N, UNTOLD_PLACE_MM, OUTLINE_PLACE_MM = 0.1, 1.2, 0.3
"""How far off forces and places are that nothing was told of: measured on three gels unlike the known one."""


@dataclass(frozen=True)
class PartialTransfer:
    """A calibrated readout, and how it came about; errors are NaN of what no press told.

    `misfits` are by form, of held-out presses; `held` says in sentences what was kept as on the known gel, `field` how
    the force field was fitted, of a model that has one, or why not.
    """

    readout: AxisymmetricReadout | FieldReadout
    form: str
    misfits: Mapping[str, float]
    before: Errors
    after: Errors
    weights: int
    pens: int
    outline: bool
    held: tuple[str, ...]
    whole: Mapping[str, float]
    presses: int = 0
    objection: str = ''
    field: str = ''

    @property
    def told_presses(self) -> str:
        """What was known of how many presses: '3 pens', '10 weights at unknown places'."""
        whole = self.presses - self.weights - self.pens
        counts = (
            (self.weights, 'weights at unknown places'), (self.pens, 'pens'),
            (whole, 'presses of known place and force'),
        )  # fmt: skip
        return ', '.join(f'{count} {name}' for count, name in counts if count) or 'the outline of the gel'

    @property
    def reason(self) -> str:
        """The form and why this one, and what the calibration does not know."""
        return '; '.join([told_reason(self.form, self.misfits), *self.held])

    def as_dict(self) -> dict[str, Any]:
        """What a model's card says of it; None of what no press told."""
        plain = asdict(replace(self, readout=None))  # type: ignore[arg-type]
        plain |= {'before': self.before.as_dict(), 'after': self.after.as_dict()}
        return {**{name: value for name, value in plain.items() if name != 'readout'}, 'reason': self.reason}


def seen_through(
    typical: Typical, view: np.ndarray, outline: OutlineMap | None, half_px: float
) -> AxisymmetricResponse:
    """The known gel's response, as a camera would see it that shows the outline of the gel elsewhere.

    `view` is where the regions are (-1 to 1), `half_px` how much 1 is in the rest images.
    """
    if outline is None:
        return typical.at(view)
    response = typical.at(outline.back(view * half_px) / half_px)
    return replace(response, couplings=np.einsum('ab,rbd->rad', outline.turn, response.couplings))


def transfer_outline(known: AxisymmetricReadout, outline: OutlineMap, half_px: float) -> PartialTransfer:
    """The readout for a gel of which nothing but its rest image is known."""
    view = views(known.scaling.trusted)
    response = seen_through(Typical.of(known.response, view), view, outline, half_px)
    nothing = Errors(math.nan, math.nan, math.nan)
    readout = replace(known, response=response, doubt=FIRST_DOUBT, correction=replace(known.correction, local=None))
    readout = replace(readout, calibration=_calibration(readout, np.full((0, 3), np.nan), True))
    held = (HARDNESS_HELD, 'places follow the outline of the gel alone')
    return PartialTransfer(readout, 'outline', {}, nothing, nothing, 0, 0, True, held, dict.fromkeys(SIZES, 0.0))


HARDNESS_HELD = 'no force is known, so the gel counts as hard as the known one'
PLACES_HELD = 'no places are known, so the camera counts as seated as on the known gel'


def transfer_partial(
    known: AxisymmetricReadout,
    dataset: Dataset,
    outline: OutlineMap | None = None,
    half_px: float = 220.0,
    progress: Progress | None = None,
) -> PartialTransfer:
    """The readout for the gel of a data set; NaN in its presses is what is not known: x and y, or the force.

    Args:
        known: the readout of a known gel.
        dataset: presses; a depth above 0 says that something touched.
        outline: how the outline of the known gel maps onto that of this one, where there are both rest images.
        half_px: half the side of the square that features are measured in, in pixels of the rest images.
        progress: shown meanwhile.

    Raises:
        DatasetError: presses from which no calibration follows.
    """
    _require_presses(dataset)
    gel = _Gel.of(known, dataset, outline, half_px)
    with (progress or Progress()).bar('comparing forms', 2) as bar:
        whole = gel.whole(gel.presses)
        bar.advance(1, 'whole')
        misfits, responses = gel.judged(whole)
        bar.advance(1, 'regions')
    form = next(name for name in misfits if misfits[name] <= WORTH * min(misfits.values()))
    response = whole.whole.response if form == 'whole' else gel.regions(whole, gel.presses)
    held = np.concatenate([live_errors(gel.readout(made), dataset, rows) for made, rows in responses[form]])
    readout = gel.readout(response)
    calibration = _calibration(readout, held, outline is not None)
    noise = least_gain(readout, dataset, gel.other.untouched)
    readout = replace(readout, calibration=replace(calibration, least_gain=max(calibration.least_gain, noise)))
    free = unknown(gel.presses)
    return PartialTransfer(
        readout, form, misfits, Errors.of(live_errors(known, dataset, gel.other.rows)), Errors.of(held),
        int(free[:, 0].sum()), int(free[:, 2].sum()), outline is not None, gel.held,
        {name: float(value) for name, value in zip(SIZES, whole.whole.numbers, strict=True)}, len(gel.presses),
    )  # fmt: skip


@dataclass(frozen=True)
class _Gel:
    """The other gel, and what its presses can tell of it."""

    other: OtherGel
    start: AxisymmetricResponse
    outline: bool

    @classmethod
    def of(cls, known: AxisymmetricReadout, dataset: Dataset, outline: OutlineMap | None, half_px: float) -> _Gel:
        other = OtherGel.of(known, dataset)
        return cls(other, seen_through(other.typical, other.view, outline, half_px), outline is not None)

    @property
    def presses(self) -> Presses:
        return self.other.presses

    @property
    def held(self) -> tuple[str, ...]:
        """What no press tells, in sentences."""
        hardness = () if self._tells_force(self.presses) else (HARDNESS_HELD,)
        return hardness if self.outline or _places(self.presses.contacts) >= LEAST_PLACES else (*hardness, PLACES_HELD)

    def readout(self, response: AxisymmetricResponse) -> AxisymmetricReadout:
        """The known gel's readout with another response."""
        source = self.other.source
        return replace(
            source, scaling=self.other.scaling, response=response, doubt=FIRST_DOUBT, carried=None,
            correction=replace(source.correction, local=None), pressed_n=self.other.pressed_n,
        )  # fmt: skip

    @staticmethod
    def _tells_force(presses: Presses) -> bool:
        return bool(np.isfinite(presses.contacts[:, 2]).any())

    def whole(self, presses: Presses, begin: PartialFit | None = None) -> PartialFit:
        """What differs as a whole, of the numbers that these presses tell."""
        placed = _places(presses.contacts) >= LEAST_PLACES
        kept = {*(() if self._tells_force(presses) else HARDNESS), *(() if placed or self.outline else SHIFT)}
        free = tuple(name for name in SIZES if name not in kept)
        sizes = SEEN_OUTLINE if self.outline and not placed else {}
        return fit_partial(self.start, presses, free, self.other.source.correction.reach_mm, begin=begin, sizes=sizes)

    def regions(self, whole: PartialFit, presses: Presses) -> AxisymmetricResponse:
        """With every region's own numbers; what is unknown of presses follows along."""
        begun, contacts, reach_mm = whole.whole.response, whole.contacts, self.other.source.correction.reach_mm

        def placed(response: AxisymmetricResponse) -> Presses:
            nonlocal contacts
            if response is not begun:  # by that the whole fit has found them
                contacts = located(response, presses, reach_mm, begin=contacts)
            return at(presses, contacts)

        return self.other.regions_of(begun, placed, REGION_TURNS, ASIDE)

    def judged(
        self, whole: PartialFit
    ) -> tuple[dict[str, float], dict[str, list[tuple[AxisymmetricResponse, np.ndarray]]]]:
        """Each form's misfit on held-out presses, and its response without each fold beside that fold's samples."""
        fold = folds_of_partial(self.presses.contacts)
        made: dict[str, list[tuple[AxisymmetricResponse, np.ndarray]]] = {'whole': []}
        left: dict[str, list[np.ndarray]] = {'whole': []}
        if len(self.presses) >= REGIONS_FROM:
            made['regions'], left['regions'] = [], []
        for number in np.unique(fold):
            rest, out = self.presses.take(fold != number), self.presses.take(fold == number)
            begin = PartialFit(whole.whole, whole.contacts[fold != number])
            fit = self.whole(rest, begin)
            for form, responses in made.items():
                response = fit.whole.response if form == 'whole' else self.regions(fit, rest)
                responses.append((response, self.other.rows[fold == number]))
                left[form].append(_left_over(response, out, self.other.source.correction.reach_mm))
        return {form: float(np.sqrt(np.mean(np.concatenate(each)))) for form, each in left.items()}, made


def folds_of_partial(contacts: Float[np.ndarray, 'n 3']) -> np.ndarray:
    """A number of 0 to 4 for each press; those at one known place have the same, unless too few places would remain."""
    together = np.isfinite(contacts[:, :1]) & (_places(contacts) > LEAST_PLACES)
    each = np.broadcast_to(1e3 + np.arange(len(contacts))[:, None], contacts.shape)  # a place of its own, far away
    return folds_of(np.where(together, contacts, each))


def _places(contacts: Float[np.ndarray, 'n 3']) -> int:
    """How many places are known."""
    return len(np.unique(contacts[np.isfinite(contacts[:, 0]), :2], axis=0))


def _left_over(response: AxisymmetricResponse, out: Presses, reach_mm: float) -> np.ndarray:
    """Squares of what presses leave over wherever their unknowns fit best, in units of what is expected."""
    contacts = located(response, out, reach_mm)
    size = np.square(out.motion).sum(axis=-1, keepdims=True)
    weight = out.certainty / (1 + out.certainty * 0.01 * size)
    return np.asarray((np.square(out.motion - response.motion(contacts)) * weight).ravel())


def _calibration(readout: AxisymmetricReadout, held: Float[np.ndarray, 'n 3'], outline: bool) -> Calibration:
    """Stated uncertainties: by held-out presses where these know, by what gels differ where nothing was told."""
    old = readout.calibration
    force = np.abs(held[np.isfinite(held[:, 2]), 2])
    place = np.abs(held[np.isfinite(held[:, 0]), :2]).reshape(-1)
    told_n = cautious(force, len(force)) / NORMAL_90 if len(force) else UNTOLD_FORCE_N
    seen_mm = OUTLINE_PLACE_MM if outline else UNTOLD_PLACE_MM
    told_mm = cautious(place, len(place) // 2) / NORMAL_90 if len(place) >= 2 * LEAST_PLACES else seen_mm
    return replace(
        old, place_floor_mm=max(told_mm, old.place_floor_mm), force_floor_n=max(told_n, old.force_floor_n),
        place_factors=(1.0,), force_factors=(1.0,),
    )  # fmt: skip


def _require_presses(dataset: Dataset) -> None:
    presses = dataset.presses[dataset.presses[:, 2] > 0][:, [0, 1, 3]]
    known = np.isfinite(presses)
    if len(presses) < LEAST_PRESSES:
        raise DatasetError(f'a calibration needs {LEAST_PRESSES} presses at least, not {len(presses)}; record more')
    if (known[:, 0] != known[:, 1]).any():
        raise DatasetError('of a press x is known and y is not, or the other way round; give both, or neither (NaN)')
    if not known.any(axis=1).all():
        raise DatasetError(
            'of a press neither place nor force is known; leave it out, or say where it was or what it weighed'
        )
