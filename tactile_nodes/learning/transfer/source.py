"""The gel that a calibration begins with: an axisymmetric readout, or what a measured response says of one."""

from __future__ import annotations

from typing import cast

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.learning.axisymmetric.fit import measured
from tactile_nodes.learning.axisymmetric.regions import FIRST_DOUBT, LEAST_NOISE_PX, Presses
from tactile_nodes.learning.config import AxisymmetricConfig
from tactile_nodes.sensing.explain.arrays import AnyReadout
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout, Correction
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.splines import cubes

SAMPLED = 1200
PER_TURN = 300
SEED = 1
LIGHTEST = 0.02
"""Of the hardest press: the lightest that the response is asked about."""


def axisymmetric_source(readout: AnyReadout) -> AxisymmetricReadout:
    """What can be transferred of a readout.

    Of a response that is what its table says of presses all over it. The table holds little of what happens close to a
    press, so an axisymmetric readout, trained on presses, is the better source.

    Raises:
        ModelError: it is a network.
    """
    if isinstance(readout, AxisymmetricReadout):
        return readout
    if not isinstance(readout, ResponseReadout):
        raise ModelError(
            f'a {readout.kind} does not say how the gel responds; choose an axisymmetric model, such as portable'
        )
    if _LAST and _LAST[0][0] is readout:
        return _LAST[0][1]
    _LAST[:] = [(readout, _derived(readout))]
    return _LAST[0][1]


_LAST: list[tuple[ResponseReadout, AxisymmetricReadout]] = []
"""A calibration that grows with the presses asks again and again for the same."""


def _derived(readout: ResponseReadout) -> AxisymmetricReadout:
    response = measured(readout.scaling, readout.bins, _asked(readout), AxisymmetricConfig(presses_per_turn=PER_TURN))
    reach = min(readout.response.x.high, readout.response.y.high)
    return AxisymmetricReadout(
        readout.scaling,
        response,
        FIRST_DOUBT,
        Correction.none(reach, response.hardest_n),
        readout.bins,
        most_contacts=readout.most_contacts,
    )


def _asked(readout: ResponseReadout) -> Presses:
    """The motion that a response's table tells of random presses."""
    response, random = readout.response, np.random.default_rng(SEED)
    low, high = (np.array([getattr(axis, end) for axis in response.axes]) for end in ('low', 'high'))
    low[2] = LIGHTEST * high[2]
    places = random.uniform(low, high, (SAMPLED, 3))
    flat = response.coefficients.reshape(-1, response.coefficients.shape[-1])
    components = cubes(*response.axes, places) @ flat
    inputs = components @ np.linalg.inv(readout.whitening.astype(float)).T @ readout.likeness.directions
    known = np.flatnonzero(readout.scaling.trusted.reshape(-1) > 0)
    gain = readout.scaling.gain.reshape(-1, 2)[known].astype(float)
    motion = inputs.reshape(SAMPLED, -1, 2)[:, known] / gain
    contacts = np.column_stack([places[:, :2], places[:, 2] ** (1 / response.power)])
    certainty = np.broadcast_to(1 / (1 / gain**2 + LEAST_NOISE_PX**2), motion.shape)
    return Presses(contacts, cast('np.ndarray', motion), certainty)
