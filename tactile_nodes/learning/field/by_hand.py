"""The force field by presses of which not all is known: weights put anywhere, pens at marks.

The field is fitted to presses of which place and force are known, by the rules for bags. Where these are too few there
is no field: one of a gel whose hardness nobody told would be as far off as the gels differ.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.alone import transfer_alone
from tactile_nodes.learning.field.calibration import Pressed, fit_beside_tips
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import require_presses
from tactile_nodes.learning.transfer.fit import reached_mm
from tactile_nodes.learning.transfer.judgement import told as told_errors
from tactile_nodes.learning.transfer.partial import PartialTransfer
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout


def with_field_by_hand(
    loaded: LoadedModel,
    made: PartialTransfer,
    dataset: Dataset,
    pressed: Pressed,
    progress: Progress | None = None,
    *,
    forced: bool = False,
) -> PartialTransfer:
    """A calibration of a model `field`, its tips being calibrated already; without the field where too little is known.

    Raises:
        DatasetError: by the presses the camera is another than described, and nobody forced it.
        ConfigurationError: the body is wider than the gel.
    """
    if not isinstance(loaded.model.readout, FieldReadout) or not isinstance(made.readout, AxisymmetricReadout):
        return made
    known, count = _known(dataset), int((dataset.presses[:, 2] > 0).sum())
    whole = int((known.presses[:, 2] > 0).sum())
    told = f'of {count} presses {whole} have a place and a force that are known'
    try:
        require_presses(known, reached_mm(made.readout))
    except DatasetError as error:
        return replace(made, field=f'not fitted, so this model reads tips alone: {told}; {error}')
    fit = fit_beside_tips(loaded, made.readout, known, pressed, progress, forced=forced)
    told += f'; {fit.reason}; it reads held-out presses {told_errors(fit.errors)} off by itself (medians)'
    return replace(made, readout=replace(fit.readout, tips=made.readout), field=told, objection=fit.objection)


def alone_by_hand(
    loaded: LoadedModel, dataset: Dataset, pressed: Pressed, progress: Progress | None = None, *, forced: bool = False
) -> PartialTransfer:
    """The field of bodies that are no ball, or several, by presses of which place and force are known.

    Raises:
        DatasetError, ConfigurationError: as of `transfer_alone`.
    """
    made = transfer_alone(loaded, _known(dataset), pressed, progress, forced=forced)
    return PartialTransfer(
        made.readout, made.form, made.misfits, made.before, made.after, 0, 0, False, (), made.whole, made.presses,
        objection=made.objection, field=made.field,
    )  # fmt: skip


def _known(dataset: Dataset) -> Dataset:
    """Without presses of which place or force is unknown."""
    touched = dataset.presses[:, 2] > 0
    return dataset.take(np.flatnonzero(~touched | dataset.known))
