"""Presses of known bodies, with the layer's prediction for each region and each term.

The body's pressure follows from the layer's response to its shape and its force, so the contact of a ring grows with
the force as that of a ball does. Forces are grouped in steps: within one the pressure has one shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Float32, Int

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import Bodies, KnownBody
from tactile_nodes.sensing.elasticity.indentation import Indentation, Indenter
from tactile_nodes.sensing.elasticity.regions import TERMS, Regions
from tactile_nodes.sensing.elasticity.view import DEPTHS
from tactile_nodes.sensing.explain.field.weights import region_weights
from tactile_nodes.sensing.explain.network import InputScaling

DEEPEST = 0.18
"""Share of the gel's thickness up to which a press is used: 0.5 N of the paper's tip, 1.1 mm deep."""

LEAST_LINEAR, MOST_FITTED = 10, 300
STEP = 1.25
"""Forces within this factor share the shape of their pressure: a ball's contact differs by 8 %."""

LIGHTEST_N = 1e-3
MOST_STEPS = 60
"""Forces from 1.5 µN to 0.65 MN are searched."""

DEPTH_SIGMA, SLOPE_SIGMA_MM, SUM_SIGMA = 0.5, 0.2, 0.05
"""Prior spread of regions: of a depth's share, relative to a fifth; of the offset of their rays (mm); and of the sum
of all depths, relative to that sum.

All regions see one gel, so a region differs only in its division among the depths. With a free sum, ten held-out
presses leave 0.81 of what is expected, with a fixed one 0.77; twenty leave 0.735 and 0.725 (simulated gels 11 to 13).
"""

DOUBT = 0.02
"""Relative error of a region's motion if its response was fitted to presses."""

LEAST_NOISE_PX = 0.004

LEAST_RANGE = 0.3
"""Forces whose range is less than this share of the largest do not determine the offset."""


@dataclass(frozen=True)
class BodyPresses:
    """The motion of the known regions under presses of a known body, and the prediction of each term of their response.

    `terms` is motion (px) under the press's own force, `weights` the inverse of the expected variance of a motion,
    `centre_mm` the centre of pressure, `rows` the rows of the samples in their data set.
    """

    terms: Float32[np.ndarray, 'n regions 2 terms']
    motion: Float[np.ndarray, 'n regions 2']
    weights: Float[np.ndarray, 'n regions']
    centre_mm: Float[np.ndarray, 'n 2']
    force_n: Float[np.ndarray, ' n']
    rows: Int[np.ndarray, ' n']

    def __len__(self) -> int:
        return len(self.motion)

    def take(self, chosen: np.ndarray) -> BodyPresses:
        """Some of the presses."""
        return BodyPresses(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def misfit(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """RMS of the residuals with these shares, in units of their expected standard deviation."""
        left = self.motion - np.einsum('nrpt,rt->nrp', self.terms, shares)
        return float(np.sqrt((np.square(left).sum(axis=-1) * self.weights).sum() / (2 * (self.weights > 0).sum())))

    def gain(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """The common factor on all shares that fits best."""
        predicted = np.einsum('nrpt,rt->nrp', self.terms, shares)
        weights = self.weights[..., None]
        return float((weights * predicted * self.motion).sum() / max((weights * predicted * predicted).sum(), 1e-12))

    def offset_n(self, shares: Float[np.ndarray, 'regions terms'], fold: Int[np.ndarray, ' n']) -> tuple[float, float]:
        """The force at which motion vanishes, and its standard deviation by leaving out fold after fold."""
        predicted, weights = np.einsum('nrpt,rt->nrp', self.terms, shares), self.weights[..., None]
        shown = (
            (weights * predicted * self.motion).sum(axis=(1, 2))
            / (weights * predicted * predicted).sum(axis=(1, 2))
            * self.force_n
        )
        if np.ptp(self.force_n) < LEAST_RANGE * self.force_n.max():
            return 0.0, 0.0
        rest = [fold != out for out in np.unique(fold)]
        found = np.array([_begins(self.force_n[each], shown[each]) for each in rest])
        return _begins(self.force_n, shown), float(np.sqrt((len(found) - 1) * found.var()))

    def fitted(self, shares: Float[np.ndarray, 'regions terms']) -> Float[np.ndarray, 'regions terms']:
        """Shares of every region that explain its motion best, with the given ones as prior."""
        sigma, summed = np.zeros((DEPTHS, 3)), np.zeros((DEPTHS, 3))
        scale = float(shares[0, ::3].mean())
        sigma[:, 0], sigma[:, 1:] = DEPTH_SIGMA * scale, SLOPE_SIGMA_MM * scale
        summed[:, 0] = DEPTH_SIGMA / (SUM_SIGMA * DEPTHS)
        left = self.motion - np.einsum('nrpt,rt->nrp', self.terms, shares)
        levers = (self.terms * sigma.reshape(-1)).astype(float)
        weighted = levers * self.weights[..., None, None]
        prior = np.eye(TERMS) + np.outer(summed, summed)
        information = np.einsum('nrpt,nrpu->rtu', weighted, levers, optimize=True) + prior
        towards = np.einsum('nrpt,nrp->rt', weighted, left, optimize=True)
        return shares + sigma.reshape(-1) * np.linalg.solve(information, towards[..., None])[..., 0]


def _begins(force_n: Float[np.ndarray, ' n'], shown: Float[np.ndarray, ' n']) -> float:
    """The force at which a line through the values crosses zero."""
    slope, height = np.polyfit(force_n, shown, 1)
    return float(-height / slope) if slope > 0 else 0.0


class Pressures:
    """The pressure of a body on a sensor's gel, by force."""

    def __init__(self, regions: Regions, body: KnownBody) -> None:
        body.require_within(regions.sensor)
        self._indenter = Indenter(regions.surface, body.over(regions.surface.nodes_mm))
        self._thickness_mm = sum(regions.sensor.gel.layers_mm)
        self._known: dict[int, Indentation] = {}

    @staticmethod
    def steps(force_n: Float[np.ndarray, ' n']) -> Int[np.ndarray, ' n']:
        """The step of each force."""
        steps: np.ndarray = np.round(np.log(force_n) / math.log(STEP)).astype(int)
        return steps

    def at(self, step: int) -> Indentation:
        """The pressure of a step."""
        if step not in self._known:
            self._known[step] = self._indenter.pressed(STEP**step)
        return self._known[step]

    def about(self, force_n: float) -> Indentation:
        """The pressure of the step of a force; without force that of the lightest step."""
        return self.at(int(self.steps(np.array([max(force_n, LIGHTEST_N)]))[0]))

    @cached_property
    def most_n(self) -> float:
        """The force up to which the layer is linear under the body, from its depth at that force."""
        step, deepest_mm = 0, DEEPEST * self._thickness_mm
        while self.at(step).depth_mm <= deepest_mm and step < MOST_STEPS:
            step += 1
        while self.at(step).depth_mm > deepest_mm and step > -MOST_STEPS:
            step -= 1
        near = [self.at(step).depth_mm, self.at(step + 1).depth_mm]
        return float(STEP ** np.interp(deepest_mm, near, [step, step + 1]))


class AllPressures:
    """The pressure of each body on a sensor's gel.

    Raises:
        ConfigurationError: one is wider than the gel.
    """

    def __init__(self, regions: Regions, bodies: Bodies) -> None:
        self.bodies = bodies
        self.each = [Pressures(regions, body) for body in bodies.known]

    def linear(self, rows: Int[np.ndarray, ' n'], force_n: Float[np.ndarray, ' n']) -> Int[np.ndarray, ' chosen']:
        """The samples that are light enough for the linear layer; if too few are, the lightest.

        Raises:
            DatasetError: none has a force that is known.
        """
        known = np.flatnonzero(np.isfinite(force_n) & (force_n > 0))
        if not known.size:
            raise DatasetError('no press has a known force, which the force field needs; check the force sensor')
        which = self.bodies.of[rows[known]]
        heavy = force_n[known] / np.array([each.most_n for each in self.each])[which]
        order = np.argsort(heavy, kind='stable')[: max(int((heavy <= 1).sum()), min(LEAST_LINEAR, len(known)))]
        chosen = np.sort(order)
        by_body = chosen[np.argsort(which[chosen], kind='stable')]
        return np.sort(known[by_body[:: max(1, math.ceil(len(by_body) / MOST_FITTED))]])


def presses_of(
    regions: Regions,
    pressures: AllPressures,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' n'],
    softer: float = 1.0,
    advance: Callable[[int], object] = lambda _: None,
) -> BodyPresses:
    """Some samples of a data set; `softer` is the gel's softness as a multiple of the described one."""
    known, motion = motion_of(scaling, dataset, rows)
    place, force = dataset.presses[rows][:, :2].astype(float), dataset.presses[rows][:, 3].astype(float)
    terms, centre = np.zeros((len(rows), len(known), 2, TERMS), np.float32), place.copy()
    for same, centre_mm, spectrum in shapes_of(regions, pressures, dataset, rows, softer):
        centre[same] += centre_mm
        terms[same] = regions.terms_of_pressure(place[same], spectrum, known) * force[same, None, None, None]
        advance(len(same))
    return BodyPresses(terms, motion, weights_of(scaling, dataset, rows, motion), centre, force, rows)


def motion_of(
    scaling: InputScaling, dataset: Dataset, rows: Int[np.ndarray, ' n']
) -> tuple[Int[np.ndarray, ' known'], Float[np.ndarray, 'n known 2']]:
    """The known regions, and their motion since rest (px)."""
    known = known_of(scaling)
    motion = (dataset.features[rows].astype(np.float32) - scaling.mean).reshape(len(rows), -1, 2)[:, known]
    return known, motion.astype(float)


def weights_of(
    scaling: InputScaling, dataset: Dataset, rows: Int[np.ndarray, ' n'], motion: Float[np.ndarray, 'n known 2']
) -> Float[np.ndarray, 'n known']:
    """The inverse of the expected variance of each motion."""
    sure = dataset.confidence[dataset.rest[rows]].reshape(len(rows), -1)[:, known_of(scaling)]
    return region_weights(motion, sure, noise_px(scaling), DOUBT)


def shapes_of(
    regions: Regions, pressures: AllPressures, dataset: Dataset, rows: Int[np.ndarray, ' n'], softer: float
) -> Iterator[tuple[Int[np.ndarray, ' same'], Float[np.ndarray, ' 2'], Complex[np.ndarray, 'ky kx']]]:
    """Samples that share a shape of pressure, its centre relative to their place (mm), and its spectrum."""
    kinds = np.column_stack([pressures.bodies.of[rows], Pressures.steps(dataset.presses[rows][:, 3] * softer)])
    for body, step in np.unique(kinds, axis=0).tolist():
        shape = pressures.each[body].at(step)
        spectrum = regions.layer.points(shape.place_mm, shape.force_n)
        yield np.flatnonzero((kinds == (body, step)).all(axis=1)), shape.centre_mm, spectrum


def known_of(scaling: InputScaling) -> Int[np.ndarray, ' known']:
    """Indices of the known regions."""
    return np.flatnonzero(scaling.trusted.reshape(-1) > 0)


def noise_px(scaling: InputScaling) -> float:
    """The noise of the median region."""
    known = scaling.gain[scaling.trusted > 0]
    return max(float(np.median(1 / known)), LEAST_NOISE_PX)
