"""Judge fits of the response by presses that they did not see.

Motion determines the depths of each region's markers, and the softness of the gel as far as the layer explains motion.
Where it does not, as it may between printed dots, and if a refinement corrects the total, the gain follows from the
estimated forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.presses import DOUBT, BodyPresses, noise_px
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.fit import WORTH
from tactile_nodes.sensing.elasticity.regions import Regions
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.field.refinement import Refinement
from tactile_nodes.sensing.explain.field.solver import Field
from tactile_nodes.sensing.explain.field.spread import FieldSpread
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.metrics import interval_factor
from tactile_nodes.shapes import Float, Float32, Int

FORMS = 'description', 'gain', 'regions'

UNFITTED = 0.04
"""Relative error of a region's motion if its response follows from the description."""

UNPRESSED, FEW = 0.05, 10
"""Relative error of forces where no press measured the regions' response. If a ball pressed, it falls with the root of
the number of presses beyond `FEW`. For a tip, a punch, a square or a ring leaves 6 to 8 % even with sixty presses."""

NEAR_THE_SURFACE, OF_DOTS = 0.12, 0.2
"""The same for markers near the surface, and for printed dots. With these 90 % intervals hold 18 of 20 totals on
`9dtact_like` (with 0.1 only 16), and all on the others (`tactile bench sensors --seed 101`, with `gel.moduli_off` set
to zero)."""

REFINED = 0.6
"""Share of these errors that a refinement leaves, which also corrects the total."""

PASSES = 3
"""Passes in which a field is solved for markers near the surface."""

JUDGES = 40
ROOM = 2.0
"""Factor on the misfit of held-out presses beyond which a frame is out of distribution: drags and wide contacts of
other bodies leave residuals this much larger."""

EXPLAINED = 1.5
"""Limit in multiples of the expected residual; motion with a larger one does not determine the gel's softness. If
forces determined the softness of the gel that ships, its totals would be 5 % off instead of 2 % (`tactile bench
contacts --each 4 --no-disturbances`, 100 presses)."""

IN_SIGHT = 0.15
"""Presses that are less visible (`FieldSolver.hidden`) do not determine the gel's softness: at the rim of the camera's
view, as on `digit_like`, a ball reads too high."""

NEARLY_AS_GOOD = 1.03
"""Errors within this factor count as equal, because the estimates of a few dozen presses scatter."""

LEAST_GAIN, MOST_GAIN = 0.05, 20.0
"""Limits of a gel's softness, as a multiple of the described one."""


@dataclass(frozen=True)
class Held:
    """Held-out presses as estimated by fits that did not see them: misfits, and errors of x, y (mm) and force (N).

    `force_n` is the true force, `softened` as in `BodyPresses`, `fold` the fold of each press. `hidden` is as in
    `FieldSolver`.
    """

    misfits: Float[np.ndarray, ' n']
    off: Float[np.ndarray, 'n 3']
    force_n: Float[np.ndarray, ' n']
    softened: Float[np.ndarray, ' n']
    fold: Int[np.ndarray, ' n']
    hidden: Float[np.ndarray, ' n']

    @classmethod
    def of(
        cls, readouts: Sequence[FieldReadout], dataset: Dataset, presses: BodyPresses, fold: Int[np.ndarray, ' n']
    ) -> Held:
        """Estimates of some presses by the refined field of each readout, without its readout of tips."""
        judges = np.arange(len(presses))[:: max(1, len(presses) // JUDGES)]
        misfits, off, hidden = [], [], []
        for number in judges.tolist():
            row, readout = int(presses.rows[number]), readouts[number]
            values, confidence = dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]]
            noise_px, motion, weights = readout.weighed(values, confidence)
            found = readout.refined(readout.solver.field(motion, weights), motion, noise_px)
            misfits.append(found.misfit)
            hidden.append(readout.solver.hidden(found.forces_n[0]))
            off.append(_off(found, readout, presses.centre_mm[number], presses.force_n[number]))
        chosen = presses.force_n[judges], presses.softened[judges], fold[judges]
        return cls(np.array(misfits), np.array(off), *chosen, np.array(hidden))

    @property
    def misfit(self) -> float:
        """The misfit that one press of a hundred exceeds."""
        return float(np.percentile(self.misfits, 99))

    @property
    def errors(self) -> Errors:
        """The errors of the estimates."""
        return Errors.of(self.off)

    @property
    def place_mm(self) -> float:
        """Standard deviation of a place along an axis, whose 90 % interval contains nine of ten; 0 without any."""
        off_mm = np.abs(self.off[:, :2][np.isfinite(self.off[:, :2])])
        return float(np.quantile(off_mm, 0.9)) / interval_factor() if off_mm.size else 0.0

    @property
    def gain(self) -> float:
        """The factor by which forces are overestimated, as the median of the presses: 0.67 if the gel is half as hard
        again as the response."""
        return self._gain(np.ones(len(self.force_n), bool))

    @property
    def gains(self) -> dict[int, float]:
        """The same factor for each fold, by all presses outside that fold."""
        return {int(out): self._gain(self.fold != out) for out in np.unique(self.fold)}

    def over(self, gains: Mapping[int, float]) -> Held:
        """The same estimates with the forces of each fold divided by a gain."""
        gain = np.array([gains[int(each)] for each in self.fold])
        off_n = (self.off[:, 2] + self.force_n) / gain - self.force_n
        return replace(self, off=np.column_stack([self.off[:, :2], off_n]))

    @property
    def cost(self) -> float:
        """Geometric mean of force error (mean logarithm of the factor) and place error (median distance in mm).

        In newtons the few forces that are overestimated most would dominate. They made the fit keep the description
        of a gel that was half as hard again.
        """
        away = np.hypot(self.off[:, 0], self.off[:, 1])
        off = np.abs(np.log(np.maximum(self._times, LEAST_GAIN))).mean()
        return math.sqrt(off * (np.nanmedian(away) if np.isfinite(away).any() else np.inf))

    @property
    def _times(self) -> Float[np.ndarray, ' n']:
        """Estimated force over true force, for presses of usual depth."""
        times: np.ndarray = (1 + self.off[:, 2] / self.force_n) / self.softened
        return times

    def _gain(self, chosen: np.ndarray) -> float:
        seen = chosen & (self.hidden <= IN_SIGHT)
        chosen = seen if seen.any() else chosen
        if not chosen.any():
            return 1.0
        return float(np.clip(np.median(self._times[chosen]), LEAST_GAIN, MOST_GAIN))


@dataclass(frozen=True)
class Judge:
    """Estimates presses with fits of the response to other presses.

    `start` is each term's share by the description, `softening` as in `BodyPresses`, `refinement` as in `FieldReadout`.
    """

    terms: Float32[np.ndarray, 'regions 2 terms unknowns']
    scaling: InputScaling
    regions: Regions
    dataset: Dataset
    by_ball: bool
    start: Float[np.ndarray, 'regions terms']
    softening: float = 0.0
    refinement: Refinement | None = None

    @property
    def learnt_totals(self) -> bool:
        """Whether forces determine the gel's softness, because a refinement knows where the layer is not linear."""
        return self.refinement is not None and not self.refinement.keeps_total

    def readout(
        self, form: str, shares: Float[np.ndarray, 'regions terms'], presses: int, limit: float = ROOM
    ) -> FieldReadout:
        """The readout with these shares, fitted to this number of presses."""
        doubt, response = DOUBT if form == 'regions' else UNFITTED, response_of(self.terms, shares)
        noise, spread = noise_px(self.scaling), self._spread(form, presses)
        softer = np.float32(shares[:, ::3].sum(axis=1).mean())
        return FieldReadout(
            self.scaling, response, self.regions.bins, noise, doubt, spread, limit, surface=softer * self._surface,
            passes=passes_of(self.regions), refinement=self.refinement,
        )  # fmt: skip

    def _spread(self, form: str, presses: int) -> FieldSpread:
        """The uncertainty of a fit, with the difference between very light contacts and usual ones."""
        spread = spread_of(form, presses, self.regions, self.refinement, by_ball=self.by_ball)
        return replace(spread, response=math.hypot(spread.response, self.softening))

    def described(self, presses: BodyPresses, fold: Int[np.ndarray, ' n']) -> Held:
        """Estimates of some presses by the description alone."""
        return self._read(presses, fold, dict.fromkeys(np.unique(fold).tolist(), self._as_described))

    def read(
        self, form: str, presses: BodyPresses, fold: Int[np.ndarray, ' n'], held: Mapping[int, np.ndarray]
    ) -> Held:
        """Estimates of the presses of each fold, by the fit that did not see it."""
        return self._read(presses, fold, {out: self.readout(form, each, len(presses)) for out, each in held.items()})

    def _read(self, presses: BodyPresses, fold: Int[np.ndarray, ' n'], readouts: Mapping[int, FieldReadout]) -> Held:
        return Held.of([readouts[each] for each in fold.tolist()], self.dataset, presses, fold)

    @cached_property
    def _as_described(self) -> FieldReadout:
        return self.readout('description', self.start, 0)

    @cached_property
    def _surface(self) -> Float32[np.ndarray, '2 near near']:
        """Motion of the described gel's surface under shear."""
        return self.regions.surface_under_shear


@dataclass(frozen=True)
class Chosen:
    """The share of each term in the form that presses support, for all presses and for all but each fold.

    `gain` is the gel's softness as a multiple of the described one.
    """

    form: str
    gain: float
    shares: Float[np.ndarray, 'regions terms']
    held: Mapping[int, Float[np.ndarray, 'regions terms']]
    misfits: Mapping[str, float]

    @classmethod
    def of(cls, judge: Judge, presses: BodyPresses, fold: Int[np.ndarray, ' n']) -> Chosen:
        """The form that held-out presses support.

        One gain is taken if forces are read better with it, and regions are compared with that (`simplest_form`). If
        markers lie near the surface, regions are not fitted: their motion under a ball says little about other bodies,
        whose places would be less exact than without presses.
        """
        start, described = judge.start, judge.described(presses, fold)
        rest = {int(out): presses.take(np.flatnonzero(fold != out)) for out in np.unique(fold)}
        softer = {out: each.gain(start) for out, each in rest.items()}
        fits = {
            'description': _Fit(start, dict.fromkeys(rest, start)),
            'gain': _Fit(presses.gain(start) * start, {out: gain * start for out, gain in softer.items()}),
        }
        if not judge.regions.near:
            fits['regions'] = _Fit(_regions(presses, start), {out: _regions(each, start) for out, each in rest.items()})
        misfits = {form: fit.misfit(presses, fold) for form, fit in fits.items()}
        read = {'description': described, 'gain': described.over(softer)}
        if misfits.get('regions', math.inf) * WORTH < misfits['gain']:
            read['regions'] = judge.read('regions', presses, fold, fits['regions'].held)
        for form in set(read) - {'description'}:
            if misfits[form] > EXPLAINED or judge.learnt_totals:
                fits[form], read[form] = fits[form].times(read[form]), read[form].over(read[form].gains)
        form = 'gain' if read['gain'].cost * NEARLY_AS_GOOD < read['description'].cost else 'description'
        if 'regions' in read:
            form = simplest_form({each: read[each].over(read[each].gains).cost for each in (form, 'regions')}, misfits)
        gain = float(fits['gain'].shares[:, ::3].sum() / start[:, ::3].sum())
        return cls(form, gain, fits[form].shares, fits[form].held, misfits)


def simplest_form(costs: Mapping[str, float], misfits: Mapping[str, float]) -> str:
    """The simplest form whose estimates and residuals of held-out presses are nearly as good as the best.

    The estimates of a few dozen presses alone do not decide. With a hundred presses on a gel, the forms gain and
    regions agreed to 5 % in forces and places, but of ten families of contacts they misplaced 17 and 14 % of the
    force. The residuals of motion separated the two: 0.86 and 0.66 times what is expected.

    A field overestimates the force of tips by a few per cent with any response. Regions are therefore compared without
    the factor that all forces have in common. With it, a gel with held sides kept one gain after 40 presses, and 19.5 %
    of the force of ten families was misplaced instead of 16.5 % (`tactile bench sides`).

    Args:
        costs: the errors of estimates of each form that may be chosen (`Held.cost`).
        misfits: the residuals of their motion.
    """
    together = {form: cost * misfits[form] for form, cost in costs.items()}
    return next(form for form in FORMS if together.get(form, math.inf) <= NEARLY_AS_GOOD * min(together.values()))


@dataclass(frozen=True)
class _Fit:
    """The share of each term by all presses, and by all but each fold."""

    shares: Float[np.ndarray, 'regions terms']
    held: Mapping[int, Float[np.ndarray, 'regions terms']]

    def misfit(self, presses: BodyPresses, fold: Int[np.ndarray, ' n']) -> float:
        """The misfit of the presses that a fit did not see."""
        found = [presses.take(np.flatnonzero(fold == out)).misfit(shares) for out, shares in self.held.items()]
        return float(np.sqrt(np.mean(np.square(found))))

    def times(self, read: Held) -> _Fit:
        """The fit with its softness multiplied by the factor of overestimated forces."""
        gains = read.gains
        held = {out: gains.get(out, read.gain) * shares for out, shares in self.held.items()}
        return _Fit(read.gain * self.shares, held)


def _regions(presses: BodyPresses, start: Float[np.ndarray, 'regions terms']) -> Float[np.ndarray, 'regions terms']:
    """Separate shares for every region."""
    return presses.fitted(presses.gain(start) * start)


def _off(
    found: Field, readout: FieldReadout, centre_mm: Float[np.ndarray, ' 2'], force_n: float
) -> tuple[float, float, float]:
    """Errors of centre (mm) and force (N); that of the centre is NaN without force."""
    pressed, total = found.forces_n[0], float(found.forces_n[0].sum())
    place = pressed @ readout.solver.patches.centres_mm / total if total > 0 else np.full(2, math.nan)
    x, y = (place - centre_mm).tolist()
    return x, y, total - float(force_n)


def spread_of(
    form: str, presses: int, regions: Regions, refinement: Refinement | None = None, *, by_ball: bool = True
) -> FieldSpread:
    """The relative error of forces where no press measured the regions' response."""
    if regions.near:
        off = OF_DOTS if regions.dotted else NEAR_THE_SURFACE
        return FieldSpread(response=off if refinement is None or refinement.keeps_total else REFINED * off)
    measured = by_ball and form == 'regions' and presses > FEW
    return FieldSpread(response=UNPRESSED * (math.sqrt(FEW / presses) if measured else 1.0))


def passes_of(regions: Regions) -> int:
    """The number of passes in which a frame is solved."""
    return PASSES if regions.near else 1


def response_of(
    terms: Float32[np.ndarray, 'regions 2 terms unknowns'], shares: Float[np.ndarray, 'regions terms']
) -> Float32[np.ndarray, 'rows unknowns']:
    """Motion under 1 N on each patch, with these shares of the terms."""
    summed: np.ndarray = np.einsum('rptu,rt->rpu', terms, shares.astype(np.float32), optimize=True)
    return summed.reshape(-1, summed.shape[-1])
