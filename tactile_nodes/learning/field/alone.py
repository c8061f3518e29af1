"""Calibrate the force field by presses of a body that is no ball: what they tell of tips is nothing.

A model of the field alone reads tips as any other contact. What reads tips in its source knows the markers and the
camera of another gel, and nothing that a ring or a punch shows says better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.calibration import Pressed, known_presses
from tactile_nodes.learning.field.fit import fit_field, regions_of
from tactile_nodes.learning.field.presses import BodyPresses, Pressures
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import (
    require_presses,
    require_tared,
)
from tactile_nodes.learning.transfer.errors import Errors
from tactile_nodes.learning.transfer.fit import Transfer, at_rest, pressed_gel, reached_mm
from tactile_nodes.learning.transfer.judgement import objection, of_the_mean, require_worth
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.reading import Contact

BENT = 0.1
"""Share of the median force by which presses seem to begin aside of nothing because the layer is not quite linear: of
punches, squares and rings up to 2 N it is 0.03 to 0.075."""


def presses_tell_tips(loaded: LoadedModel, pressed: Pressed) -> bool:
    """Whether what reads tips is calibrated: of any model but a field that has none of it, or that no ball pressed.

    Raises:
        ModelError: nobody says what pressed.
    """
    readout = loaded.model.readout
    return not isinstance(readout, FieldReadout) or (readout.tips is not None and pressed.known_body(loaded).is_ball)


def centres(loaded: LoadedModel, pressed: Pressed) -> Callable[[float], tuple[float, float]]:
    """Where the middle of the pressure is beside the body's origin (mm), by its force.

    Raises:
        ModelError: nobody says what pressed.
    """
    readout = loaded.model.readout
    if not isinstance(readout, FieldReadout) or presses_tell_tips(loaded, pressed):
        return lambda _: (0.0, 0.0)
    pressures = Pressures(regions_of(pressed.known_sensor(loaded), readout.scaling), pressed.known_body(loaded))

    def centre(force_n: float) -> tuple[float, float]:
        x, y = pressures.about(force_n).centre_mm.tolist()
        return x, y

    return centre


def centre_of(contacts: Sequence[Contact]) -> tuple[float, float, float]:
    """Where the middle of what is read lies (mm), and the whole force (N); NaN of the middle of no force."""
    force = np.array([each.force_n for each in contacts])
    places = np.array([[each.x_mm, each.y_mm] for each in contacts])
    x, y = (force @ places / force.sum()).tolist() if force.sum() > 0 else (math.nan, math.nan)
    return x, y, float(force.sum())


def transfer_alone(
    loaded: LoadedModel,
    dataset: Dataset,
    pressed: Pressed,
    progress: Progress | None = None,
    *,
    forced: bool = False,
    curve: bool = False,
) -> Transfer:
    """The field of another gel; `forced` as for `transfer`, `curve` as for `with_field`.

    Raises:
        DatasetError: presses from which no calibration follows, or which it would read no better than its source.
        ConfigurationError: the body is wider than the gel.
    """
    body, source = pressed.known_body(loaded), loaded.model.readout
    assert isinstance(source, FieldReadout)
    require_presses(dataset, reached_mm(source.tips) if source.tips else (source.bins.width_mm, source.bins.height_mm))
    scaling, _, pressed_rows = pressed_gel((source.tips or source).scaling, dataset)
    rows, fold = known_presses(dataset, pressed_rows)
    fit = fit_field(
        pressed.known_sensor(loaded), at_rest(scaling), dataset, rows, fold, body, progress, curve=curve
    )  # fmt: skip
    assert fit.by is not None
    offset_n, spread_n = fit.offset_n
    require_tared(offset_n, max(spread_n, BENT * float(np.median(fit.by.force_n))))
    before = Errors.of(_read(source, dataset, fit.by))
    contacts = np.column_stack([fit.by.centre_mm, fit.by.force_n])
    said = objection('calibration', fit.errors, before, of_the_mean(contacts))
    require_worth(said, 'keep the model, or press at more places', forced=forced)
    why = (
        f'presses of {body.card_name} tell nothing of tips' if source.tips else 'the model has nothing that reads tips'
    )
    told = f'alone: {why}, which the field reads as any other contact'
    return Transfer(
        fit.readout, fit.form, fit.misfits, before, fit.errors, len(fit.by), offset_n, {'gain': fit.gain}, said, told,
        fit.curve,
    )  # fmt: skip


def _read(readout: FieldReadout, dataset: Dataset, presses: BodyPresses) -> Float[np.ndarray, 'n 3']:
    """Errors of centre (mm) and force (N) as the model to begin with reads these presses."""
    errors = []
    for row, centre, force_n in zip(presses.rows.tolist(), presses.centre_mm, presses.force_n, strict=True):
        found = readout.read(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        x, y, _ = centre_of(found.contacts)
        errors.append((x - centre[0], y - centre[1], found.normal_force_n.sum() - force_n))
    return np.reshape(errors, (-1, 3)).astype(float)
