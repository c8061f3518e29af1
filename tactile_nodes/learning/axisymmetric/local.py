"""The local residuals of a calibrated readout, at its own presses, interpolated to places nearby.

Every press of a calibration has a known place and force, so the error of the readout there is known except for noise.
Part of it is specific to the gel: single markers, which profiles that are the same everywhere cannot follow. Presses
nearby share it. It is interpolated as a Gaussian process (Rasmussen and Williams, Gaussian Processes for Machine
Learning, 2006, section 2.2) into a table, and fades away from presses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_nodes.learning.axisymmetric.calibration import LEAST_FORCE_N
from tactile_nodes.learning.axisymmetric.regions import Presses
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout, Observation
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.shapes import Float, Int

ALIKE_MM = 2.5
"""Distance at which errors correlate by 0.61; 1.5 to 4 mm are about as good on development gels."""
OWN, OF_A_PICTURE = 0.3, 0.7
"""Variances relative to the spatially correlated part: of each press, and of the noise of one image."""
FARTHEST = 4.0
"""Limit in multiples of the median: larger errors are clipped to it, since the press itself may be wrong."""
NODES = 29


def with_local(readout: AxisymmetricReadout, presses: Presses, pictures: Int[np.ndarray, ' n']) -> AxisymmetricReadout:
    """The readout with a table that removes its errors at presses; each press is a mean of `pictures` images.

    An existing table is extended.
    """
    raw = replace(readout, calibration=Calibration(), most_contacts=1)
    observed = [
        Observation(*each) for each in zip(presses.motion, raw.certainty_of(presses.certainty > 0), strict=True)
    ]
    usable = np.flatnonzero([each.enough for each in observed])
    if not len(usable):
        return readout
    found = np.stack([raw.fit(observed[number]).contacts[0] for number in usable.tolist()])
    # In distances and forces of the gel that the profiles were measured on, like corrections.
    truth, estimated = presses.contacts[usable] / readout.unit, readout.corrected(found) / readout.unit
    table = interpolated(truth[:, :2], wrong_by(estimated, truth), pictures[usable], readout.correction.reach_mm)
    if readout.correction.local is not None:
        table = readout.correction.local + table
    return replace(readout, correction=replace(readout.correction, local=table))


def wrong_by(estimated: Float[np.ndarray, 'n 3'], truth: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n 3']:
    """Corrections to add to estimates: x, y and a share of the force; large ones are clipped."""
    wrong = truth - estimated
    wrong[:, 2] /= np.maximum(estimated[:, 2], LEAST_FORCE_N)
    farthest = FARTHEST * np.median(np.abs(wrong), axis=0)
    return np.asarray(np.clip(wrong, -farthest, farthest))


def interpolated(
    places: Float[np.ndarray, 'n 2'],
    values: Float[np.ndarray, 'n values'],
    pictures: Int[np.ndarray, ' n'],
    reach_mm: float,
) -> Float[np.ndarray, 'nodes nodes values']:
    """Values at places, interpolated to a grid from minus to plus the reach along x and y."""
    along = np.linspace(-reach_mm, reach_mm, NODES)
    grid = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    own = np.diag(OWN + OF_A_PICTURE / pictures)
    table: np.ndarray = _alike(grid, places) @ np.linalg.solve(_alike(places, places) + own, values)
    return table.reshape(NODES, NODES, -1)


def _alike(some: Float[np.ndarray, 'm 2'], others: Float[np.ndarray, 'n 2']) -> Float[np.ndarray, 'm n']:
    squared = np.square(some[:, None] - others).sum(axis=-1)
    return np.asarray(np.exp(-squared / (2 * ALIKE_MM**2)))
