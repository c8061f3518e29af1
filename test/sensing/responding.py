"""A gel whose response is known exactly: the motion field of a tip as splines made by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.splines import SplineAxis, value_and_slopes
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.sensing.geometry import BinGrid

BINS = BinGrid()
GRID = 6
COMPONENTS = 24
AXES = SplineAxis(-12.0, 12.0, 12), SplineAxis(-12.0, 12.0, 12), SplineAxis(0.0, 1.0, 4)


def response(growth: float = 0.0, scale: float = 400.0, seed: int = 4) -> Response:
    """Regions move away from the tip, the more the nearer and the harder; seen in COMPONENTS mixtures of them.

    Coefficients are the field's values where each spline is centred, so that it is smooth, and none without force.
    """
    x, y, s = (axis.low + (np.arange(axis.count) - 1) * (axis.high - axis.low) / axis.intervals for axis in AXES)
    along = np.linspace(-11, 11, GRID)
    regions = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    away = regions[None, None] - np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1)[:, :, None]
    field = away * np.exp(-(away**2).sum(axis=-1, keepdims=True) / (2 * 4.0**2)) / 4.0
    mixtures = np.linalg.qr(np.random.default_rng(seed).normal(size=(2 * GRID**2, COMPONENTS)))[0]
    table = np.einsum('ijc,k->ijkc', field.reshape(len(x), len(y), -1) @ mixtures, s) * scale
    return Response(*AXES, table.astype(np.float32), np.full(COMPONENTS, growth, np.float32))


def components(of: Response, *contacts: Sequence[float]) -> np.ndarray:
    """What contacts (x, y, s) cause together, without noise."""
    total = sum(value_and_slopes(of.axes, of.coefficients, each)[0].astype(float) for each in contacts)
    return np.asarray(total, np.float32) if contacts else np.zeros(COMPONENTS, np.float32)


def readout(most_contacts: int = 3, **of_response: float) -> ResponseReadout:
    """Features are the components themselves, spread along orthonormal directions."""
    directions = np.linalg.qr(np.random.default_rng(5).normal(size=(2 * GRID**2, COMPONENTS)))[0].T
    shape = (GRID, GRID, 2)
    scaling = InputScaling(np.zeros(shape, np.float32), np.ones(shape, np.float32), np.ones(shape[:2], np.float32))
    likeness = Likeness(np.zeros(2 * GRID**2, np.float32), np.ascontiguousarray(directions, np.float32), 2.0, 0.1)
    # With noise of 1 in 24 components the mean square stays below 1.6² but once in a million times.
    calibration = Calibration(misfit_limit=1.6, least_gain=12.0)
    return ResponseReadout(
        scaling, likeness, np.eye(COMPONENTS, dtype=np.float32), response(**of_response), BINS, calibration,
        most_contacts,
    )  # fmt: skip


def features(of: ResponseReadout, seen: np.ndarray) -> np.ndarray:
    """Features of which a readout sees these components."""
    return np.asarray(seen @ of.likeness.directions, np.float32).reshape(GRID, GRID, 2)
