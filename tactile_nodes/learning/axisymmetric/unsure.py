"""The covariance of the regions' numbers after few presses, in the factors that a readout uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_nodes.learning.axisymmetric.regions import PRESSES_AT_ONCE, Presses, by_regions, levers
from tactile_nodes.sensing.explain.axisymmetric.response import AxisymmetricResponse
from tactile_nodes.shapes import Float

FACTORS = 4
"""Factors kept of a region's eleven numbers a channel: those that add most variance to motion all over the gel. With
all eleven, forces are hardly closer."""
ACROSS = 8
"""Number of places along x and along y at which the uncertainty is evaluated."""
LEAST = 1e-9
"""Added to the covariance of levers (px^2), so that directions that no press determines are not singular."""


def with_unsure(
    response: AxisymmetricResponse,
    presses: Presses,
    precision: Float[np.ndarray, 'regions numbers numbers'],
    doubt: Float[np.ndarray, ' distances'],
) -> AxisymmetricResponse:
    """The response with the uncertainty of its regions, fitted to presses with a prior of this precision."""
    covariance = np.linalg.inv(precision + _precision_of_presses(response, presses, doubt))
    count, everywhere = response.couplings.shape[2], response.columns_and_slopes(_everywhere(presses))
    lever = levers(response, *everywhere)
    channels = []
    for channel in (0, 1):
        own = np.r_[channel * count : (channel + 1) * count, 2 * count : 2 * count + 2]
        channels.append(_factors(covariance[:, own][:, :, own], lever[:, :, channel, own]))
    return replace(response, unsure=np.stack(channels, axis=1))


def _precision_of_presses(
    response: AxisymmetricResponse, presses: Presses, doubt: Float[np.ndarray, ' distances']
) -> Float[np.ndarray, 'regions numbers numbers']:
    """The precision of each region's numbers from the presses."""
    precision = np.zeros(())
    for part in np.array_split(np.arange(len(presses)), max(1, len(presses) // PRESSES_AT_ONCE)):
        some = presses.take(part)
        columns, slopes = response.columns_and_slopes(some.contacts)
        weight = some.weights(response, doubt, response.with_sides(response.motion_of_columns(columns), some.contacts))
        lever = by_regions(levers(response, columns, slopes) * weight[..., None])
        precision = precision + lever.transpose(0, 2, 1) @ lever
    return precision


def _everywhere(presses: Presses) -> Float[np.ndarray, 'n 3']:
    """Contacts all over the pressed surface, at the median force."""
    low, high = presses.contacts[:, :2].min(axis=0), presses.contacts[:, :2].max(axis=0)
    x, y = (each.ravel() for each in np.meshgrid(*np.linspace(low, high, ACROSS).T))
    return np.column_stack([x, y, np.full(len(x), np.median(presses.contacts[:, 2]))])


def _factors(
    covariance: Float[np.ndarray, 'regions numbers numbers'], lever: Float[np.ndarray, 'n regions numbers']
) -> Float[np.ndarray, 'regions numbers factors']:
    """The factors of covariances that matter most for these levers (principal components in their metric)."""
    metric = np.einsum('nri,nrj->rij', lever, lever) / len(lever) + LEAST * np.eye(lever.shape[2])
    root = np.linalg.cholesky(metric)
    values, vectors = np.linalg.eigh(root.transpose(0, 2, 1) @ covariance @ root)
    most = vectors[:, :, -FACTORS:] * np.sqrt(np.maximum(values[:, None, -FACTORS:], 0.0))
    factors: np.ndarray = np.linalg.solve(root.transpose(0, 2, 1), most)
    return factors
