"""Presses of known bodies, with the layer's prediction for each region and each term.

The body's pressure follows from the layer's response to its shape and its force, so the contact of a ring grows with
the force as that of a ball does. Forces are grouped in steps: within one the pressure has one shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.body import Bodies, KnownBody
from tactile_nodes.learning.transfer.mounting import gives_way_px
from tactile_nodes.sensing.elasticity.indentation import Indentation, Indenter
from tactile_nodes.sensing.elasticity.regions import TERMS, Regions
from tactile_nodes.sensing.elasticity.view import DEPTHS
from tactile_nodes.sensing.explain.camera import STILL, without_camera
from tactile_nodes.sensing.explain.field.weights import region_weights
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.shapes import Complex, Float, Float32, Int

DEEPEST = 0.18
"""Share of the gel's thickness up to which a press is used: 0.5 N of the paper's tip, 1.1 mm deep."""

NEAR_DEEPEST = 0.08
"""The same for spheres near the surface: deeper bodies move them less in proportion, so that with a gain by deep
presses the forces of other contacts would be too large."""

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

SOFTENING, SOFTENING_SIGMA, MOST_SOFTENING = 0.1, 0.08, 0.3
"""How much less the deepest press moves a gel than a linear layer: expected, its standard deviation, and at most.

If all presses counted as if the layer were linear, the forces of other contacts, which are less deep, would be too
high: that of a ring by over 5 % after presses of a punch or a square (`pytest
test/learning/field/test_field_bodies.py`)."""

PRESS_OFF, MOST_OFF = 0.05, 0.5
"""Relative error of the motion under one press, and the largest one that counts."""

DOUBT = 0.02
"""Relative error of a region's motion if its response was fitted to presses."""

LEAST_NOISE_PX = 0.004

LEAST_RANGE = 0.3
"""Forces whose range is less than this share of the largest do not determine the offset."""


@dataclass(frozen=True)
class BodyPresses:
    """The motion of the known regions under presses of a known body, and the prediction of each term of their response.

    `terms` is motion (px) under the press's own force, `weights` the inverse of the expected variance of a motion,
    `centre_mm` the centre of pressure, `rows` the rows of the samples in their data set. `softened` is the motion
    under each press over that of a linear layer, which is 1 for the lighter half on average; `softening` is how much
    more a very light press moves the gel than those. `camera` is as in `axisymmetric.regions.Presses`.
    """

    terms: Float32[np.ndarray, 'n regions 2 terms']
    motion: Float[np.ndarray, 'n regions 2']
    weights: Float[np.ndarray, 'n regions']
    centre_mm: Float[np.ndarray, 'n 2']
    force_n: Float[np.ndarray, ' n']
    rows: Int[np.ndarray, ' n']
    softened: Float[np.ndarray, ' n']
    softening: float = 0.0
    camera: Float[np.ndarray, 'terms motions'] = field(default_factory=lambda: STILL)

    def __len__(self) -> int:
        return len(self.motion)

    def take(self, chosen: np.ndarray) -> BodyPresses:
        """Some of the presses."""
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.name != 'camera'}
        return replace(self, **{name: each[chosen] for name, each in values.items() if isinstance(each, np.ndarray)})

    def at_usual_depth(self, shares: Float[np.ndarray, 'regions terms'], depth: Float[np.ndarray, ' n']) -> BodyPresses:
        """The presses, predicted for a gel that moves less, the deeper they go; `depth` is relative to its thickness.

        How much less follows from the presses (Bayesian linear regression). Their lighter half sets the scale.
        """
        depth = depth / depth.max()
        off = np.clip(np.log(np.maximum(self._gains(shares), 1e-6)), -MOST_OFF, MOST_OFF)
        beyond, usual = depth - depth.mean(), float(depth[depth <= np.median(depth)].mean())
        towards = SOFTENING / SOFTENING_SIGMA**2 - float(beyond @ off) / PRESS_OFF**2
        softening = towards / (SOFTENING_SIGMA**-2 + float(beyond @ beyond) / PRESS_OFF**2)
        softening = min(max(softening, 0.0), MOST_SOFTENING)
        softened = np.exp(-softening * (depth - usual))
        terms = self.terms * softened.astype(np.float32)[:, None, None, None]
        return replace(self, terms=terms, softened=softened, softening=softening * usual)

    def _gains(self, shares: Float[np.ndarray, 'regions terms']) -> Float[np.ndarray, ' n']:
        """The factor on all shares that fits each press best, over the median of these factors."""
        along, squared = self._products(shares)
        gains: np.ndarray = along / np.maximum(squared, 1e-12)
        return gains / max(float(np.median(gains)), 1e-6)

    def _products(
        self, shares: Float[np.ndarray, 'regions terms']
    ) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, ' n']]:
        """The weighted products of each press's prediction with its motion, and with itself."""
        motion, predicted = (self._still(each) for each in (self.motion, self._predicted(shares)))
        along, squared = ((self.weights[..., None] * predicted * each).sum(axis=(1, 2)) for each in (motion, predicted))
        return along, squared

    def _predicted(self, shares: Float[np.ndarray, 'regions terms']) -> Float[np.ndarray, 'n regions 2']:
        predicted: np.ndarray = np.einsum('nrpt,rt->nrp', self.terms, shares)
        return predicted

    def _still(self, motion: Float[np.ndarray, 'n regions 2']) -> Float[np.ndarray, 'n regions 2']:
        """Motion without that of the camera."""
        return without_camera(self.camera, motion, self.certainty)

    @property
    def certainty(self) -> Float[np.ndarray, 'n regions 2']:
        """The weights of both directions."""
        return np.repeat(self.weights[..., None], 2, axis=-1)

    def gives_px(self, shares: Float[np.ndarray, 'regions terms'], camera: Float[np.ndarray, 'terms motions']) -> float:
        """See `gives_way_px`; with the gain that fits best."""
        left = self.motion - self.gain(shares) * self._predicted(shares)
        return gives_way_px(camera, left, self.certainty, self.force_n)

    def misfit(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """RMS of the residuals with these shares, in units of their expected standard deviation."""
        left = self._still(self.motion - self._predicted(shares))
        return float(np.sqrt((np.square(left).sum(axis=-1) * self.weights).sum() / (2 * (self.weights > 0).sum())))

    def gain(self, shares: Float[np.ndarray, 'regions terms']) -> float:
        """The common factor on all shares that fits best."""
        along, squared = self._products(shares)
        return float(along.sum() / max(squared.sum(), 1e-12))

    def offset_n(self, shares: Float[np.ndarray, 'regions terms'], fold: Int[np.ndarray, ' n']) -> tuple[float, float]:
        """The force at which motion vanishes, and its standard deviation by leaving out fold after fold."""
        shown = self._gains(shares) * self.force_n
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
        left = self._still(self.motion - self._predicted(shares))
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
        self._near, self._thickness_mm = regions.near and not regions.dotted, sum(regions.sensor.gel.layers_mm)
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

    def depth(self, force_n: float) -> float:
        """The depth of the body under a force, over the gel's thickness."""
        return self.about(force_n).depth_mm / self._thickness_mm

    @cached_property
    def most_n(self) -> float:
        """The force up to which the layer is linear under the body, from its depth at that force."""
        step, deepest_mm = 0, (NEAR_DEEPEST if self._near else DEEPEST) * self._thickness_mm
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
        return np.sort(known[order])

    def few(self, rows: Int[np.ndarray, ' n']) -> Int[np.ndarray, ' few']:
        """The samples that a fit uses: at most `MOST_FITTED`, of each body the same share."""
        by_body = np.argsort(self.bodies.of[rows], kind='stable')
        return np.sort(by_body[:: max(1, math.ceil(len(by_body) / MOST_FITTED))])

    def depths(self, rows: Int[np.ndarray, ' n'], force_n: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' n']:
        """The depth of samples with these forces, over the gel's thickness."""
        bodies = self.bodies.of[rows].tolist()
        return np.array([self.each[body].depth(force) for body, force in zip(bodies, force_n.tolist(), strict=True)])


def presses_of(
    regions: Regions,
    pressures: AllPressures,
    scaling: InputScaling,
    dataset: Dataset,
    rows: Int[np.ndarray, ' n'],
    softer: float = 1.0,
    advance: Callable[[int], object] = lambda _: None,
    camera: Float[np.ndarray, 'terms motions'] = STILL,
) -> BodyPresses:
    """Some samples of a data set; `softer` is the gel's softness as a multiple of the described one."""
    known, motion = motion_of(scaling, dataset, rows)
    place, force = dataset.presses[rows][:, :2].astype(float), dataset.presses[rows][:, 3].astype(float)
    terms, centre = np.zeros((len(rows), len(known), 2, TERMS), np.float32), place.copy()
    for same, centre_mm, spectrum in shapes_of(regions, pressures, dataset, rows, softer):
        centre[same] += centre_mm
        terms[same] = regions.terms_of_pressure(place[same], spectrum, known) * force[same, None, None, None]
        advance(len(same))
    presses = BodyPresses(
        terms, motion, weights_of(scaling, dataset, rows, motion), centre, force, rows, np.ones(len(rows)),
        camera=camera,
    )  # fmt: skip
    return presses.at_usual_depth(nominal(regions, scaling), pressures.depths(rows, force * softer))


def nominal(regions: Regions, scaling: InputScaling) -> Float[np.ndarray, 'regions terms']:
    """The prior share of each term, without any presses."""
    return np.tile(regions.nominal_shares, (len(known_of(scaling)), 1))


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
