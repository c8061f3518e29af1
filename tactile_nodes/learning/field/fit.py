"""The response of a sensor's regions to forces on its surface: from its description, and from presses of a known ball.

What the description leaves open is few numbers: one for the whole gel (its modulus), or for each region at which depths
its markers lie and where its rays meet the gel (fifteen, see `tactile_nodes.sensing.elasticity.regions`). Three forms
from the simplest on: the description alone, one gain, regions. Presses that a fit did not see decide between them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer_fit import WORTH
from tactile_nodes.sensing.elasticity.regions import DEPTHS, TERMS, Regions
from tactile_nodes.sensing.explain.readout import FieldReadout
from tactile_nodes.sensing.explain.spread import FieldSpread
from tactile_nodes.sensing.explain.weights import region_weights
from tactile_nodes.sensing.network import InputScaling
from tactile_nodes.sensors import Sensor

FORMS = 'description', 'gain', 'regions'
LINEAR = 12.5
"""Force over modulus and radius squared up to which a ball's press serves: 0.5 N of the paper's tip, 1.1 mm deep."""

LEAST_LINEAR, MOST_FITTED = 10, 300
PRESSED_SHARE = 0.9
"""Of a ball's radius: its contact is no wider, however deep it is pressed."""

RADIUS_STEP_MM = 0.1
DEPTH_SIGMA, SLOPE_SIGMA_MM = 0.5, 0.15
"""How far regions differ: in what a depth counts, as a share of its fifth, and in how far off their rays are (mm).

Slopes held much tighter cannot follow a camera that is half a millimetre aside of its description.
"""

DOUBT, UNFITTED = 0.02, 0.04
"""Share of its motion by which the response of a region is off: fitted to presses, and as a description has it."""

LEAST_NOISE_PX = 0.004
UNPRESSED, FEW = 0.05, 10
"""Share by which forces are off where no press told how regions respond; it falls with the root of the presses beyond
so few."""

JUDGES = 40
ROOM = 2.0
"""Times the misfit of presses that were held out, beyond which a frame is unlike what the response knows: drags and
wide contacts of other bodies leave so much more over."""


@dataclass(frozen=True)
class FieldFit:
    """A readout, and how it came about; `misfits` by form are root mean squares of what held-out presses leave over."""

    readout: FieldReadout
    form: str
    gain: float
    presses: int
    misfits: Mapping[str, float]

    @property
    def reason(self) -> str:
        """Why this form, in a sentence."""
        if not self.misfits:
            return f'{self.form}: no press says more'
        told = ', '.join(f'{name} {value:.2f}' for name, value in self.misfits.items())
        return f'{self.form}: what held-out presses leave unexplained is {told} times what is expected'


@dataclass(frozen=True)
class BallPresses:
    """What the known regions show under presses of a ball, beside what each term of their response makes of them.

    `terms` is motion (px) under the press's own force, `weights` one over the variance that is expected of a motion.
    """

    terms: Float32[np.ndarray, 'n regions 2 terms']
    motion: Float[np.ndarray, 'n regions 2']
    weights: Float[np.ndarray, 'n regions']

    def __len__(self) -> int:
        return len(self.motion)

    def take(self, chosen: np.ndarray) -> BallPresses:
        """Some of them."""
        return BallPresses(self.terms[chosen], self.motion[chosen], self.weights[chosen])

    def misfit(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """Root mean square of what these shares leave over, in units of what is expected."""
        left = self.motion - np.einsum('nrpt,rt->nrp', self.terms, shares)
        return float(np.sqrt((np.square(left).sum(axis=-1) * self.weights).sum() / (2 * (self.weights > 0).sum())))

    def gain(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """What all shares have to be multiplied with."""
        told = np.einsum('nrpt,rt->nrp', self.terms, shares)
        weights = self.weights[..., None]
        return float((weights * told * self.motion).sum() / max((weights * told * told).sum(), 1e-12))

    def fitted(self, shares: Float[np.ndarray, 'regions terms']) -> Float[np.ndarray, 'regions terms']:
        """Shares of every region that explain its motion best, near those given."""
        sigma = np.zeros((DEPTHS, 3))
        scale = float(shares[0, ::3].mean())
        sigma[:, 0], sigma[:, 1:] = DEPTH_SIGMA * scale, SLOPE_SIGMA_MM * scale
        left = self.motion - np.einsum('nrpt,rt->nrp', self.terms, shares)
        levers = (self.terms * sigma.reshape(-1)).astype(float)
        weighted = levers * self.weights[..., None, None]
        information = np.einsum('nrpt,nrpu->rtu', weighted, levers, optimize=True) + np.eye(TERMS)
        towards = np.einsum('nrpt,nrp->rt', weighted, left, optimize=True)
        return shares + sigma.reshape(-1) * np.linalg.solve(information, towards[..., None])[..., 0]


def described(sensor: Sensor, scaling: InputScaling, progress: Progress | None = None) -> FieldFit:
    """The readout that follows from a description alone; `scaling` says which regions are known and how they rest."""
    regions = _regions(sensor, scaling)
    shares = np.tile(regions.nominal_shares, (len(_known(scaling)), 1))
    with (progress or Progress()).bar('response of the regions', 1) as bar:
        terms = regions.terms_of_patches(_known(scaling))
        bar.advance()
    spread = FieldSpread(response=UNPRESSED)
    readout = FieldReadout(scaling, _told(terms, shares), regions.bins, _noise_px(scaling), UNFITTED, spread, ROOM)
    return FieldFit(readout, 'description', 1.0, 0, {})


def fit_field(
    sensor: Sensor,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' rows'],
    fold: Int[np.ndarray, ' rows'],
    radius_mm: float,
    progress: Progress | None = None,
) -> FieldFit:
    """The readout that presses of a ball tell, in the form that they support.

    Args:
        sensor: its description.
        scaling: which regions are known, and what they show at rest.
        dataset: holds the presses.
        rows: samples with contact, a picture of each press.
        fold: to which of some parts each press belongs, each of which is held out once.
        radius_mm: of the ball.
        progress: shows what is done.

    Raises:
        DatasetError: none of these presses has a force that is known.
    """
    progress = progress or Progress()
    regions = _regions(sensor, scaling)
    chosen = _linear(dataset.presses[rows][:, 3], sensor, radius_mm)
    rows, fold = rows[chosen], fold[chosen]
    with progress.bar('fitting the force field', len(rows) + 2) as bar:
        presses = _presses(regions, scaling, dataset, rows, radius_mm, bar.advance)
        start = np.tile(regions.nominal_shares, (presses.motion.shape[1], 1))
        held = {form: _held_out(presses, start, fold, form) for form in FORMS}
        misfits = {form: _misfit(presses, made, fold) for form, made in held.items()}
        form = next(name for name in FORMS if misfits[name] <= WORTH * min(misfits.values()))
        bar.advance(1, form)
        terms = regions.terms_of_patches(_known(scaling))
        response = _told(terms, _shares(presses, start, form))
        bar.advance()
    doubt = DOUBT if form == 'regions' else UNFITTED
    readout = FieldReadout(scaling, response, regions.bins, _noise_px(scaling), doubt)
    read = [replace(readout, response=_told(terms, shares)) for shares in held[form]]
    misfit = _misfit_of_held(read, dataset, rows, fold)
    off = UNPRESSED * (math.sqrt(min(1.0, FEW / len(rows))) if form == 'regions' else 1.0)
    readout = replace(readout, misfit_limit=ROOM * max(misfit, 1.0), spread=FieldSpread(response=off))
    return FieldFit(readout, form, presses.gain(start), len(rows), misfits)


def _regions(sensor: Sensor, scaling: InputScaling) -> Regions:
    return Regions(sensor, *scaling.trusted.shape)


def _known(scaling: InputScaling) -> Int[np.ndarray, ' known']:
    return np.flatnonzero(scaling.trusted.reshape(-1) > 0)


def _noise_px(scaling: InputScaling) -> float:
    known = scaling.gain[scaling.trusted > 0]
    return max(float(np.median(1 / known)), LEAST_NOISE_PX)


def _linear(force_n: Float[np.ndarray, ' n'], sensor: Sensor, radius_mm: float) -> Int[np.ndarray, ' chosen']:
    """Presses that are light enough for the linear layer; of heavy ones the lightest."""
    known = np.flatnonzero(np.isfinite(force_n) & (force_n > 0))
    if not known.size:
        raise DatasetError('no press has a force that is known, which the force field needs; check the force sensor')
    order = known[np.argsort(force_n[known], kind='stable')]
    most_n = LINEAR * sensor.gel.moduli_mpa[0] * radius_mm**2
    count = max(int((force_n[order] <= most_n).sum()), min(LEAST_LINEAR, len(order)))
    return np.sort(order[:count])[:: max(1, math.ceil(count / MOST_FITTED))]


def _presses(
    regions: Regions, scaling: InputScaling, dataset: Dataset, rows: np.ndarray, radius_mm: float, advance: object
) -> BallPresses:
    known = _known(scaling)
    motion = (dataset.features[rows].astype(np.float32) - scaling.mean).reshape(len(rows), -1, 2)[:, known]
    sure = dataset.confidence[dataset.rest[rows]].reshape(len(rows), -1)[:, known]
    place, force = dataset.presses[rows][:, :2].astype(float), dataset.presses[rows][:, 3].astype(float)
    motion = motion.astype(float)
    contact = _contact_mm(force, radius_mm, regions.sensor.gel.moduli_mpa[0])
    terms = np.zeros((len(rows), len(known), 2, TERMS), np.float32)
    for size in np.unique(contact).tolist():
        same = np.flatnonzero(contact == size)
        for number, seen in zip(same.tolist(), regions.terms_of_ball(place[same], size, known), strict=True):
            terms[number] = force[number] * seen
            advance(1)  # type: ignore[operator]
    return BallPresses(terms, motion, region_weights(motion, sure, _noise_px(scaling), DOUBT))


def _contact_mm(force_n: Float[np.ndarray, ' n'], radius_mm: float, modulus_mpa: float) -> Float[np.ndarray, ' n']:
    """Radius of a ball's contact as Hertz says, a³ = 3 F R / (16 G) if nu is a half, in steps."""
    contact = np.minimum(np.cbrt(3 * force_n * radius_mm / (16 * modulus_mpa)), PRESSED_SHARE * radius_mm)
    return np.maximum(np.round(contact / RADIUS_STEP_MM), 1.0) * RADIUS_STEP_MM


def _shares(presses: BallPresses, start: Float[np.ndarray, 'regions terms'], form: str) -> Float[np.ndarray, 'r t']:
    """What each term counts, in a form."""
    if form == 'description':
        return start
    gained = presses.gain(start) * start
    return gained if form == 'gain' else presses.fitted(gained)


def _held_out(
    presses: BallPresses, start: np.ndarray, fold: Int[np.ndarray, ' n'], form: str
) -> list[Float[np.ndarray, 'regions terms']]:
    """Fits to all parts but one, for each of them."""
    return [_shares(presses.take(np.flatnonzero(fold != out)), start, form) for out in np.unique(fold)]


def _misfit(presses: BallPresses, made: list[np.ndarray], fold: Int[np.ndarray, ' n']) -> float:
    parts = zip(np.unique(fold), made, strict=True)
    found = [presses.take(np.flatnonzero(fold == out)).misfit(shares) for out, shares in parts]
    return float(np.sqrt(np.mean(np.square(found))))


def _told(
    terms: Float32[np.ndarray, 'regions 2 terms unknowns'], shares: Float[np.ndarray, 'regions terms']
) -> Float32[np.ndarray, 'rows unknowns']:
    """Motion under 1 N on each patch, if each term counts so much."""
    summed: np.ndarray = np.einsum('rptu,rt->rpu', terms, shares.astype(np.float32), optimize=True)
    return summed.reshape(-1, summed.shape[-1])


def _misfit_of_held(
    read: list[FieldReadout], dataset: Dataset, rows: Int[np.ndarray, ' rows'], fold: Int[np.ndarray, ' rows']
) -> float:
    """What the field leaves over of some presses that each readout did not see: what one of a hundred exceeds."""
    judges = np.arange(len(rows))[:: max(1, len(rows) // JUDGES)]
    misfits = []
    for out, readout in zip(np.unique(fold), read, strict=True):
        for row in rows[judges[fold[judges] == out]].tolist():
            values = dataset.features[row].astype(np.float32)
            misfits.append(readout.solver.field(*readout.weighed(values, dataset.confidence[dataset.rest[row]])).misfit)
    return float(np.percentile(misfits, 99))
