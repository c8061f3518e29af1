"""The response of a sensor's regions to forces on its surface: from its description, and from presses of a known body.

What the description leaves open is few numbers: one for the whole gel (its modulus), or for each region at which depths
its markers lie and where its rays meet the gel (fifteen, see `tactile_nodes.sensing.elasticity.regions`). Three forms
from the simplest on: the description alone, one gain, regions. Presses that a fit did not see decide between them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Int

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import KnownBody
from tactile_nodes.learning.field.presses import (
    DOUBT,
    STEP,
    BodyPresses,
    Pressures,
    known_of,
    noise_px,
    presses_of,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.errors import UNKNOWN, Errors, Point
from tactile_nodes.learning.transfer.fit import WORTH
from tactile_nodes.sensing.elasticity.region_choice import usual_regions
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensors import Sensor

FORMS = 'description', 'gain', 'regions'

UNFITTED = 0.04
"""Share of its motion by which the response of a region is off as a description has it."""

UNPRESSED, FEW = 0.05, 10
"""Share by which forces are off where no press told how regions respond; it falls with the root of the presses beyond
so few, if a ball pressed. What a punch, a square or a ring tells of a tip is 6 to 8 % off with sixty presses, too.
Where motion changes much over a region (`Regions.uneven`), as under a tip on markers near the surface, by twice the
square of that as far: tips on a simulated membrane are a fifth off, and intervals of a pad with markers 0.3 to 1 mm
deep hold 93 % of 30 totals (seed 717), with once the square 77 %."""

UNEVEN_TIMES = 2.0

NEAR, PASSES = 1.0, 3
"""Unevenness beyond which markers lie so near the surface that a field is solved in passes, and how many; where fewer
regions than patches tell of forces, one does as well."""

LEAST_SEEN = 0.2
"""Share of the regions that must see the gel."""

KNOWN_CONFIDENCE = 0.1
"""Confidence from which a region counts."""

MOST_TIMES = 5.0
"""No more than a quarter: tips on a membrane are a fifth off, balls on printed dots a tenth."""

JUDGES = 40
ROOM = 2.0
"""Times the misfit of presses that were held out, beyond which a frame is unlike what the response knows: drags and
wide contacts of other bodies leave so much more over."""

CURVE = 0, 10, 30, 100
"""Presses that the error is told for, as far as there are so many."""

NEARLY = 0.9
"""Of all presses: so many are as good as all."""


@dataclass(frozen=True)
class FieldFit:
    """A readout, and how it came about; `misfits` by form are root mean squares of what held-out presses leave over.

    `by` are the presses. `errors` are of those held out, read by the field alone; `curve` those with fewer of them.
    `offset_n` is the force that they seem to begin at, and its standard deviation.
    """

    readout: FieldReadout
    form: str
    gain: float = 1.0
    by: BodyPresses | None = None
    misfits: Mapping[str, float] = field(default_factory=dict)
    errors: Errors = UNKNOWN
    curve: tuple[Point, ...] = ()
    offset_n: tuple[float, float] = (0.0, 0.0)

    @property
    def presses(self) -> int:
        """How many were fitted to."""
        return 0 if self.by is None else len(self.by)

    @property
    def reason(self) -> str:
        """Why this form, in a sentence."""
        if not self.misfits:
            return f'{self.form}: no press says more'
        told = ', '.join(f'{name} {value:.2f}' for name, value in self.misfits.items())
        return f'{self.form}: what held-out presses leave unexplained is {told} times what is expected'


def scaling_of(sensor: Sensor, gain: float) -> InputScaling:
    """The regions of a described sensor: those that see nothing but gel are known; `gain` is one over their noise (px).

    Raises:
        ConfigurationError: hardly any region sees the gel.
    """
    regions = usual_regions(sensor)
    trusted = regions.usable.reshape(regions.rows, regions.cols)
    if trusted.mean() < LEAST_SEEN:
        raise ConfigurationError(
            f'{trusted.sum()} of the {trusted.size} regions of the picture of {sensor.name} see its gel; check '
            'camera.position_mm and its focal length, gel.width_mm, gel.height_mm and mask'
        )
    shape = (*trusted.shape, 2)
    return InputScaling(
        np.zeros(shape, np.float32), np.full(shape, gain, np.float32), trusted.astype(np.float32), KNOWN_CONFIDENCE
    )


def uncovered(sensor: Sensor, scaling: InputScaling) -> InputScaling:
    """A scaling that knows no region which the sensor's mask covers, or which looks beyond the rim of a shaped gel.

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
            f'mask and rim of {sensor.name} leave {(trusted > 0).sum()} of {trusted.size} regions of its picture, too '
            'few to read a force by; cover less'
        )
    return replace(scaling, trusted=trusted)


def described(sensor: Sensor, scaling: InputScaling, progress: Progress | None = None) -> FieldFit:
    """The readout that follows from a description alone; `scaling` says which regions are known and how they rest.

    All its forces are off by as much as the moduli are, of which a picture shows nothing.
    """
    regions = regions_of(sensor, scaling)
    spread = _spread('', 0, regions.uneven)
    spread = replace(spread, response=math.hypot(spread.response, sensor.gel.moduli_off))
    with (progress or Progress()).bar('response of the regions', 1) as bar:
        response = _told(regions.terms_of_patches(known_of(scaling)), _nominal(regions, scaling))
        bar.advance()
    readout = FieldReadout(
        scaling, response, regions.bins, noise_px(scaling), UNFITTED, spread, ROOM,
        surface=regions.surface_under_shear, passes=_passes(regions),
    )  # fmt: skip
    return FieldFit(readout, 'description')


def fit_field(
    sensor: Sensor,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' rows'],
    fold: Int[np.ndarray, ' rows'],
    body: KnownBody,
    progress: Progress | None = None,
    *,
    curve: bool = False,
) -> FieldFit:
    """The readout that presses of a body tell, in the form that they support.

    Args:
        sensor: its description.
        scaling: which regions are known, and what they show at rest.
        dataset: holds the presses.
        rows: samples with contact, a picture of each press.
        fold: to which of some parts each press belongs, each of which is held out once.
        body: what pressed.
        progress: shows what is done.
        curve: whether to say what fewer presses would have told.

    Raises:
        DatasetError: none of these presses has a force that is known.
        ConfigurationError: the body is wider than the gel.
    """
    regions = regions_of(sensor, scaling)
    pressures = Pressures(regions, body)
    chosen = pressures.linear(dataset.presses[rows][:, 3].astype(float))
    rows, fold = rows[chosen], fold[chosen]
    start = _nominal(regions, scaling)
    with (progress or Progress()).bar('fitting the force field', len(rows) + 2) as bar:
        presses = presses_of(regions, pressures, scaling, dataset, rows, advance=bar.advance)
        if (gain := presses.gain(start)) > 0 and abs(math.log(gain)) > math.log(STEP) / 2:
            presses = presses_of(regions, pressures, scaling, dataset, rows, softer=gain)
        found = _Chosen.of(presses, start, fold)
        bar.advance(1, found.form)
        judge = _Judge(regions.terms_of_patches(known_of(scaling)), scaling, regions, dataset, body.is_ball)
        held = judge.read(found.form, presses, fold, found.held)
        points = _curve(judge, presses, start, fold) if curve else ()
        bar.advance()
    readout = judge.readout(found.form, found.shares, len(rows), ROOM * max(held.misfit, 1.0))
    offset = presses.offset_n(start, fold)
    return FieldFit(readout, found.form, presses.gain(start), presses, found.misfits, held.errors, points, offset)


def regions_of(sensor: Sensor, scaling: InputScaling) -> Regions:
    """The regions of a sensor's picture that a scaling tells of."""
    return Regions(sensor, *scaling.trusted.shape)


@dataclass(frozen=True)
class _Chosen:
    """What each term counts in the form that presses support, and in fits to all parts of them but one."""

    form: str
    shares: Float[np.ndarray, 'regions terms']
    held: list[Float[np.ndarray, 'regions terms']]
    misfits: Mapping[str, float]

    @classmethod
    def of(cls, presses: BodyPresses, start: Float[np.ndarray, 'regions terms'], fold: np.ndarray) -> _Chosen:
        held = {form: _held_out(presses, start, fold, form) for form in FORMS}
        misfits = {form: _misfit(presses, made, fold) for form, made in held.items()}
        form = next(name for name in FORMS if misfits[name] <= WORTH * min(misfits.values()))
        return cls(form, _shares(presses, start, form), held[form], misfits)


@dataclass(frozen=True)
class _Held:
    """Of presses that fits did not see: the misfit that one of a hundred exceeds, and how far off they are read."""

    misfit: float
    errors: Errors


@dataclass(frozen=True)
class _Judge:
    """Reads presses with what fits to others made of the response."""

    terms: Float32[np.ndarray, 'regions 2 terms unknowns']
    scaling: InputScaling
    regions: Regions
    dataset: Dataset
    by_ball: bool

    def readout(
        self, form: str, shares: Float[np.ndarray, 'regions terms'], presses: int, limit: float = ROOM
    ) -> FieldReadout:
        """As these shares have it, which so many presses told."""
        doubt, response = DOUBT if form == 'regions' else UNFITTED, _told(self.terms, shares)
        noise, spread = noise_px(self.scaling), _spread(form, presses, self.regions.uneven, by_ball=self.by_ball)
        softer = np.float32(shares[:, ::3].sum(axis=1).mean())
        return FieldReadout(
            self.scaling, response, self.regions.bins, noise, doubt, spread, limit, surface=softer * self.surface,
            passes=_passes(self.regions),
        )  # fmt: skip

    @cached_property
    def surface(self) -> Float32[np.ndarray, '2 near near']:
        """How far shear takes the surface of the described gel along."""
        return self.regions.surface_under_shear

    def read(self, form: str, presses: BodyPresses, fold: Int[np.ndarray, ' n'], held: list[np.ndarray]) -> _Held:
        """Some presses of each part, by the fit that did not see it."""
        judges = np.arange(len(presses))[:: max(1, len(presses) // JUDGES)]
        misfits, errors = [], []
        for out, shares in zip(np.unique(fold), held, strict=True):
            readout = self.readout(form, shares, len(presses))
            for number in judges[fold[judges] == out].tolist():
                found = self._field(readout, int(presses.rows[number]))
                misfits.append(found.misfit)
                errors.append(_off(found, self.regions, presses.centre_mm[number], presses.force_n[number]))
        return _Held(float(np.percentile(misfits, 99)), Errors.of(np.array(errors)))

    def _field(self, readout: FieldReadout, row: int) -> Field:
        values, confidence = self.dataset.features[row], self.dataset.confidence[self.dataset.rest[row]]
        return readout.solver.field(*readout.weighed(values.astype(np.float32), confidence)[1:])


def _passes(regions: Regions) -> int:
    """How often a frame is solved: see `NEAR`."""
    return PASSES if regions.uneven > NEAR and regions.count >= regions.patches.count else 1


def _curve(judge: _Judge, presses: BodyPresses, start: np.ndarray, fold: Int[np.ndarray, ' n']) -> tuple[Point, ...]:
    """Errors of presses that were held out, by fits to the first few of the others, and to all of them."""
    rest = [np.flatnonzero(fold != out) for out in np.unique(fold)]
    most = min(map(len, rest))
    points = []
    for count in sorted({*(n for n in CURVE if n < NEARLY * most), most}):
        made = [_few(presses.take(each[:count]), start, fold[each[:count]]) for each in rest]
        form = Counter(name for name, _ in made).most_common(1)[0][0]
        points.append(Point(count, form, judge.read(form, presses, fold, [shares for _, shares in made]).errors))
    return tuple(points)


def _few(presses: BodyPresses, start: np.ndarray, fold: Int[np.ndarray, ' n']) -> tuple[str, np.ndarray]:
    """The form that a few presses support, and what each term counts in it."""
    if len(np.unique(fold)) < 2:
        return 'description', start
    chosen = _Chosen.of(presses, start, fold)
    return chosen.form, chosen.shares


def _nominal(regions: Regions, scaling: InputScaling) -> Float[np.ndarray, 'regions terms']:
    """What each term counts if no press told anything."""
    return np.tile(regions.nominal_shares, (len(known_of(scaling)), 1))


def _spread(form: str, presses: int, uneven: float, *, by_ball: bool = True) -> FieldSpread:
    told = by_ball and form == 'regions' and presses > FEW
    return FieldSpread(
        response=UNPRESSED * (math.sqrt(FEW / presses) if told else min(max(1.0, UNEVEN_TIMES * uneven**2), MOST_TIMES))
    )


def _off(
    found: Field, regions: Regions, centre_mm: Float[np.ndarray, ' 2'], force_n: float
) -> tuple[float, float, float]:
    """By how much centre (mm) and force (N) are off; NaN of the centre of no force."""
    pressed, total = found.forces_n[0], float(found.forces_n[0].sum())
    place = pressed @ regions.patches.centres_mm / total if total > 0 else np.full(2, math.nan)
    x, y = (place - centre_mm).tolist()
    return x, y, total - float(force_n)


def _shares(presses: BodyPresses, start: Float[np.ndarray, 'regions terms'], form: str) -> Float[np.ndarray, 'r t']:
    """What each term counts, in a form."""
    if form == 'description':
        return start
    gained = presses.gain(start) * start
    return gained if form == 'gain' else presses.fitted(gained)


def _held_out(
    presses: BodyPresses, start: np.ndarray, fold: Int[np.ndarray, ' n'], form: str
) -> list[Float[np.ndarray, 'regions terms']]:
    """Fits to all parts but one, for each of them."""
    return [_shares(presses.take(np.flatnonzero(fold != out)), start, form) for out in np.unique(fold)]


def _misfit(presses: BodyPresses, made: list[np.ndarray], fold: Int[np.ndarray, ' n']) -> float:
    parts = zip(np.unique(fold), made, strict=True)
    found = [presses.take(np.flatnonzero(fold == out)).misfit(shares) for out, shares in parts]
    return float(np.sqrt(np.mean(np.square(found))))


def _told(
    terms: Float32[np.ndarray, 'regions 2 terms unknowns'], shares: Float[np.ndarray, 'regions terms']
) -> Float32[np.ndarray, 'rows unknowns']:
    """Motion under 1 N on each patch, if each term counts so much."""
    summed: np.ndarray = np.einsum('rptu,rt->rpu', terms, shares.astype(np.float32), optimize=True)
    return summed.reshape(-1, summed.shape[-1])
