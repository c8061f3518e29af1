"""Fit each region of an axisymmetric response to presses: its place and couplings, with a prior."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.sensing.explain.axisymmetric.radial_smear import RadialSmear
from tactile_nodes.sensing.explain.axisymmetric.readout import DOUBT_MM
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.sensing.explain.camera import STILL, without_camera
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.shapes import Float

PRESSES_AT_ONCE = 200
LEAST_NOISE_PX = 0.004
"""Added to the noise at rest: features are stored as 16 bit floats, and flow has errors of its own."""
OWN_NOISE_PX = 0.003
"""The part of that noise that images of one press share."""
FIRST_DOUBT = np.array([0.25, 0.2, 0.14, 0.09, 0.06, 0.04, 0.04, 0.04])
"""Relative error of a region's motion at the distances `DOUBT_MM`: from two gels; measured again if data suffice."""


def views(trusted: Float[np.ndarray, 'rows cols']) -> Float[np.ndarray, 'regions 2']:
    """The places of the known regions in the image: -1 to 1 from left to right and from top to bottom."""
    v, u = np.meshgrid(*((2 * np.arange(count) + 1) / count - 1 for count in trusted.shape), indexing='ij')
    known: np.ndarray = np.column_stack([u.ravel(), v.ravel()])[trusted.reshape(-1) > 0]
    return known


@dataclass(frozen=True)
class Presses:
    """Presses (x, y in mm, force in N), the motion of the known regions (px), and its inverse variance; 0: unseen.

    `camera` is the motion with each term of a motion of the camera (`camera_terms`), which is then found for each
    press.
    """

    contacts: Float[np.ndarray, 'n 3']
    motion: Float[np.ndarray, 'n regions 2']
    certainty: Float[np.ndarray, 'n regions 2']
    camera: Float[np.ndarray, 'terms motions'] = field(default_factory=lambda: STILL)

    @classmethod
    def of(cls, dataset: Dataset, rows: np.ndarray, scaling: InputScaling) -> Presses:
        """Some samples of a data set, relative to the rest of the scaling."""
        known = np.flatnonzero(scaling.trusted.reshape(-1) > 0)
        motion = (dataset.features[rows].astype(np.float32) - scaling.mean).reshape(len(rows), -1, 2)[:, known]
        confidence = dataset.confidence[dataset.rest[rows]].reshape(len(rows), -1)[:, known]
        certainty = 1 / (_noise_of(scaling) ** 2 + LEAST_NOISE_PX**2)
        seen = confidence >= scaling.confidence_floor
        contacts = dataset.presses[rows][:, [0, 1, 3]].astype(float)
        return cls(contacts, np.where(seen[..., None], motion, 0.0).astype(float), seen[..., None] * certainty)

    @classmethod
    def of_holds(cls, dataset: Dataset, holds: Sequence[np.ndarray], scaling: InputScaling) -> Presses:
        """One press for each hold: the mean motion of its samples, for each region over the samples that show it.

        The variance of noise and of rounding is divided by their number, that of the flow's own errors is not.
        """
        pictures = cls.of(dataset, np.concatenate(holds), scaling)
        first = np.cumsum([0, *(len(each) for each in holds[:-1])])
        shown = np.add.reduceat((pictures.certainty > 0).astype(float), first, axis=0)
        motion = np.add.reduceat(pictures.motion, first, axis=0) / np.maximum(shown, 1)
        each_time = np.square(_noise_of(scaling)) + LEAST_NOISE_PX**2 - OWN_NOISE_PX**2
        certainty = np.where(shown > 0, 1 / (each_time / np.maximum(shown, 1) + OWN_NOISE_PX**2), 0.0)
        return cls(pictures.contacts[first], motion, certainty)

    def __len__(self) -> int:
        return len(self.contacts)

    def take(self, chosen: np.ndarray | slice) -> Presses:
        """Some of the presses."""
        return Presses(self.contacts[chosen], self.motion[chosen], self.certainty[chosen], self.camera)

    def left(
        self, predicted: Float[np.ndarray, 'n regions 2'], weight: Float[np.ndarray, 'n regions 2']
    ) -> Float[np.ndarray, 'n regions 2']:
        """The residuals without the motion of the camera; `weight` is the inverse standard deviation."""
        return without_camera(self.camera, self.motion - predicted, np.square(weight))

    def still(self, response: AxisymmetricResponse, doubt: Float[np.ndarray, ' distances']) -> Presses:
        """The presses as a camera that does not move would see them, if the gel has this response."""
        predicted = response.motion(self.contacts)
        return replace(self, motion=predicted + self.left(predicted, self.weights(response, doubt, predicted)))

    def weights(
        self,
        response: AxisymmetricResponse,
        doubt: Float[np.ndarray, ' distances'],
        predicted: np.ndarray | None = None,
    ) -> np.ndarray:
        """The inverse standard deviation of each motion (n, regions, 2): noise, and a share of the predicted motion.

        `predicted` is the motion by the response, if it is known already.
        """
        predicted = response.motion(self.contacts) if predicted is None else predicted
        share = np.interp(response.distances_mm(self.contacts), DOUBT_MM, doubt)
        off = np.square(share) * np.square(predicted).sum(axis=-1)
        return np.asarray(np.sqrt(self.certainty / (1 + self.certainty * off[..., None])))


def _noise_of(scaling: InputScaling) -> Float[np.ndarray, 'regions 2']:
    """The noise at rest (px) of the known regions in one image."""
    known = np.flatnonzero(scaling.trusted.reshape(-1) > 0)
    return np.asarray(1 / scaling.gain.reshape(-1, 2)[known].astype(float))


@dataclass(frozen=True)
class Expected:
    """Prior of the numbers of each region (couplings, then place): mean and inverse covariance."""

    numbers: Float[np.ndarray, 'regions numbers']
    precision: Float[np.ndarray, 'regions numbers numbers']

    @classmethod
    def around(cls, response: AxisymmetricResponse, looseness: float = 1e-3) -> Expected:
        """A weak prior around the regions' present numbers."""
        numbers = numbers_of(response)
        return cls(numbers, np.tile(looseness * np.eye(numbers.shape[1]), (len(numbers), 1, 1)))


def numbers_of(response: AxisymmetricResponse) -> Float[np.ndarray, 'regions numbers']:
    """Couplings and place of each region in one row."""
    return np.concatenate([response.couplings.reshape(len(response.places), -1), response.places], axis=1)


def with_numbers(response: AxisymmetricResponse, numbers: Float[np.ndarray, 'regions numbers']) -> AxisymmetricResponse:
    """The response with numbers in the order of `numbers_of`."""
    return replace(response, couplings=numbers[:, :-2].reshape(response.couplings.shape), places=numbers[:, -2:])


@dataclass(frozen=True)
class Shared:
    """Numbers that all regions share: prior means, in the order of `shared_of`, and standard deviations.

    Numbers with a `sigma` of 0 are fixed.
    """

    expected: Float[np.ndarray, ' 4']
    sigma: Float[np.ndarray, ' 4']

    @property
    def free(self) -> np.ndarray:
        """Indices of the numbers that are fitted."""
        return np.flatnonzero(self.sigma)

    def equations(self, response: AxisymmetricResponse) -> tuple[np.ndarray, np.ndarray]:
        """The prior's normal equations for the free numbers, at the response's present values."""
        prior = np.diag(1 / self.sigma[self.free] ** 2)
        return prior, prior @ (self.expected - shared_of(response))[self.free]

    def moved(self, response: AxisymmetricResponse, move: Float[np.ndarray, ' free']) -> AxisymmetricResponse:
        """The response with its free numbers moved."""
        now = shared_of(response)
        now[self.free] += move
        return with_shared(response, now)


def shared_of(response: AxisymmetricResponse) -> Float[np.ndarray, ' 4']:
    """Logarithms of softness and width, then the smear's shift (mm) and squeeze."""
    smear = response.smear
    return np.array([np.log(response.softness), np.log(response.width), smear.shift_mm, smear.squeeze])


def with_shared(response: AxisymmetricResponse, numbers: Float[np.ndarray, ' 4']) -> AxisymmetricResponse:
    """The response with numbers in the order of `shared_of`."""
    softness, width = np.exp(numbers[:2]).tolist()
    return replace(response, softness=softness, width=width, smear=RadialSmear(*numbers[2:].tolist()))


def shared_levers(
    response: AxisymmetricResponse, contacts: np.ndarray, slopes: Float[np.ndarray, '3 n regions columns']
) -> Float[np.ndarray, 'n regions 2 4']:
    """Derivatives of the motion of each region by the shared numbers.

    Softness multiplies the force, so its derivative is F dm/dF. Width divides the distance, so its derivative is minus
    distance dm/d(it). Radial smear shifts a press along itself; `slopes` are those along the true place.
    """
    along_x, along_y, by_force = (response.motion_of_columns(each) for each in slopes)
    away = contacts[:, None, :2] - response.places
    by_width = -(along_x * away[..., :1] + along_y * away[..., 1:])
    smear, plain, aslant = response.smear, away / response.width, response.smear.aslant(response.places)
    bent = 1 + (smear.slopes(plain, response.places) * aslant).sum(axis=-1)
    outwards = (along_x * aslant[:, :1] + along_y * aslant[:, 1:]) * (response.width / bent)[..., None]
    by_smear = [outwards * lever[..., None] for lever in smear.levers(plain, response.places)]
    return np.stack([by_force * contacts[:, 2, None, None], by_width, *by_smear], axis=-1)


def by_regions(each: Float[np.ndarray, 'n regions 2 numbers']) -> Float[np.ndarray, 'regions motions numbers']:
    """Presses and channels in one row, for each region."""
    rows: np.ndarray = each.transpose(1, 0, 2, 3).reshape(each.shape[1], -1, each.shape[3])
    return rows


def levers(
    response: AxisymmetricResponse,
    columns: Float[np.ndarray, 'n regions columns'],
    slopes: Float[np.ndarray, '3 n regions columns'],
) -> Float[np.ndarray, 'n regions 2 numbers']:
    """Derivatives of the motion of each region by each of its numbers."""
    count = columns.shape[2]
    found = np.zeros((*columns.shape[:2], 2, 2 * count + 2))
    for channel in (0, 1):
        found[:, :, channel, channel * count : (channel + 1) * count] = columns
        for axis in (0, 1):
            found[:, :, channel, 2 * count + axis] = -(slopes[axis] * response.couplings[:, channel]).sum(axis=-1)
    return found


def measured_doubt(response: AxisymmetricResponse, presses: Presses) -> Float[np.ndarray, ' distances']:
    """The relative error of a region's motion, at the distances `DOUBT_MM` from the press.

    Noise and the uncertainty of the region's numbers are subtracted.
    """
    predicted, slopes, columns = response.motion_slopes_and_columns(presses.contacts)
    seen = presses.certainty[..., 0] > 0
    noise = np.divide(2.0, presses.certainty[..., 0], out=np.zeros_like(predicted[..., 0]), where=seen)
    noise += response.variance(slopes, columns).sum(axis=-1)
    off = presses.left(predicted, presses.weights(response, FIRST_DOUBT, predicted))
    left = (np.square(off).sum(axis=-1) - noise) / 2
    size, distance = np.square(predicted).sum(axis=-1), response.distances_mm(presses.contacts)
    borders = np.concatenate([[0.0], (DOUBT_MM[1:] + DOUBT_MM[:-1]) / 2, [np.inf]])
    shares = []
    for low, high in itertools.pairwise(borders):
        near = (distance >= low) & (distance < high) & seen
        shares.append(np.sqrt(max(left[near].sum() / max(size[near].sum(), 1e-9), 1e-4)))
    return np.array(shares)
