"""Checks that presses and model are fit for a calibration, made before anything is fitted."""

from __future__ import annotations

import numpy as np

from tactile_nodes.errors import DatasetError, ModelError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.axisymmetric.readout import LEAST_REGIONS, AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.network import InputScaling, NetworkReadout

LEAST_PRESSES = 5
LEAST_SPREAD = 0.4
"""The least span of the presses along x and along y, as a share of the area that the source model covers."""
MOST_OFFSET_N = 0.1
"""More than twice the offset that differences between gels cause."""

MOST_TIMES = 10.0
"""Largest ratio of the hardness of two gels; forces in another unit make it about 100 (N and g) or 1000 (N and mN)."""


def source_readout(loaded: LoadedModel) -> AxisymmetricReadout:
    """The readout of a model that can be transferred.

    Raises:
        ModelError: it is a network or a response measured place by place, or its features are no Cartesian motion.
    """
    readout, layout = loaded.model.readout, loaded.model.layout
    if isinstance(readout, NetworkReadout):
        raise ModelError(
            f'model {loaded.model_id} is a network, but only an axisymmetric response can be transferred to another '
            'gel; choose an axisymmetric model, such as portable, or give a network its layer: '
            'tactile calibrate --dataset FILE'
        )
    if isinstance(readout, ResponseReadout):
        raise ModelError(
            f'model {loaded.model_id} is a response measured place by place, which does not hold for another gel; '
            'start from an axisymmetric model, such as portable'
        )
    if layout.encoding != 'cartesian_mean':
        raise ModelError(
            f'model {loaded.model_id} reads {layout.encoding}, but only motion along x and y can be transferred; '
            'choose a model with encoding: cartesian_mean, such as portable'
        )
    if not isinstance(readout, FieldReadout):
        return readout
    if readout.tips is None:
        raise ModelError(
            f'model {loaded.model_id} is a field without a readout for tips, which checks the presses; start from '
            'one that has both, such as field'
        )
    return readout.tips


def require_presses(dataset: Dataset, known_mm: tuple[float, float]) -> None:
    """Refuse presses that are too few, or that span too little of what the model covers along x and along y.

    Raises:
        DatasetError: says what to do.
    """
    presses = dataset.presses[:, 2] > 0
    touched = dataset.presses[presses]
    if wrong := int((presses & ~dataset.known).sum()):
        raise DatasetError(f'images of presses whose place or force is not a number: {wrong}; leave these out')
    places = np.unique(touched[:, :2], axis=0)
    if len(places) < LEAST_PRESSES:
        raise DatasetError(
            f'a calibration needs presses at least at {LEAST_PRESSES} places, but there are {len(places)}; record more'
        )
    if not (touched[:, 3] > 0).any():
        raise DatasetError('a calibration needs presses with a force, but none has one; check the force sensor')
    for name, along, known in zip('xy', places.T, known_mm, strict=True):
        if np.ptp(along) < LEAST_SPREAD * known:
            raise DatasetError(
                f'the presses span {np.ptp(along):.1f} mm along {name} of the {known:.1f} mm that the model '
                'covers, too little to know how the gels differ elsewhere; press all over the surface'
            )


def require_motion(dataset: Dataset, scaling: InputScaling) -> None:
    """Refuse images that show markers in too few regions, or motion that is not a number.

    Raises:
        DatasetError: says what to do.
    """
    regions = int((scaling.trusted > 0).sum())
    if regions < LEAST_REGIONS:
        raise DatasetError(
            f'only {regions} regions show markers in nine of ten images, but a place needs at least '
            f'{LEAST_REGIONS}; check the camera and the light'
        )
    shown = (scaling.trusted > 0) & (dataset.confidence >= scaling.confidence_floor)[dataset.rest]
    wrong = int((shown & ~np.isfinite(dataset.features).all(axis=-1)).any(axis=(1, 2)).sum())
    if wrong:
        raise DatasetError(f'images in which the motion is not a number: {wrong}; leave these out')


def require_tared(offset_n: float, spread_n: float = 0.0) -> None:
    """Refuse forces whose offset exceeds both the differences between gels and its own uncertainty.

    `spread_n` is the standard deviation of the offset: of ten deep presses 0.06 to 0.09 N (development gels).

    Raises:
        DatasetError: says by how much.
    """
    if abs(offset_n) > MOST_OFFSET_N + spread_n:
        raise DatasetError(
            f'the forces seem to be {offset_n:+.2f} N when the gel shows none; tare the force sensor and '
            'press again, or check the given places and forces and their units'
        )


def require_unit(softness: float, *, forced: bool) -> None:
    """Refuse forces that make the gel far softer or harder than that of the model, unless forced.

    `softness` is relative to the gel of the model.

    Raises:
        DatasetError: says how many times.
    """
    if not forced and not 1 / MOST_TIMES <= softness <= MOST_TIMES:
        times, what = (softness, 'soft') if softness > 1 else (1 / softness, 'hard')
        raise DatasetError(
            f'by the given forces the gel is {times:.0f} times as {what} as that of the model: check the unit of the '
            'forces (tactile calibrate … --force uses them as they are)'
        )
