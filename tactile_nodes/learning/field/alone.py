"""Calibrate the force field alone, from presses of bodies that are no ball, or of several bodies.

Such presses do not calibrate the readout of tips. A model of the field alone treats tips as any other contact. The
source's readout of tips knows the markers and the camera of another gel, and presses of a ring or a punch do not
correct it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.field.calibration import Pressed, refinement_of
from tactile_nodes.learning.field.camera import in_words
from tactile_nodes.learning.field.fit import fit_field, regions_of
from tactile_nodes.learning.field.judging import Held
from tactile_nodes.learning.field.presses import Pressures
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer.checks import (
    require_presses,
    require_tared,
    require_unit,
)
from tactile_nodes.learning.transfer.fit import Transfer, at_rest, folds_of, pressed_gel, reached_mm
from tactile_nodes.learning.transfer.judgement import ADVICE, objection, of_the_mean, require_worth
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.reading import Contact

CONFIRMED = 0.15
"""Largest relative difference in stiffness at which a gel counts as described."""

BENT = 0.1
"""Apparent force offset as a share of the median force, because the layer is not quite linear: of punches, squares and
rings up to 2 N it is 0.03 to 0.075."""


def presses_tell_tips(loaded: LoadedModel, pressed: Pressed, dataset: Dataset) -> bool:
    """Whether tips are calibrated, too: not for a field without them, or pressed by anything but a single ball.

    Raises:
        DatasetError: an indenter is no body.
        ModelError: the body is unknown.
    """
    readout = loaded.model.readout
    if not isinstance(readout, FieldReadout):
        return True
    return readout.tips is not None and pressed.bodies(loaded, dataset).is_a_ball


def centres(loaded: LoadedModel, pressed: Pressed) -> Callable[[float, str], tuple[float, float]]:
    """The centre of pressure relative to the body's origin (mm), by the press's force (N) and its indenter's name.

    It raises:
        DatasetError: the indenter is no body.
        ModelError: the body is unknown.
    """
    readout = loaded.model.readout
    if not isinstance(readout, FieldReadout):
        return lambda *_: (0.0, 0.0)
    scaling = readout.scaling

    @cache
    def pressures(indenter: str) -> Pressures | None:
        body = pressed.named(loaded, indenter, alone=True)
        return None if body.is_ball else Pressures(regions_of(pressed.known_sensor(loaded), scaling), body)

    def centre(force_n: float, indenter: str) -> tuple[float, float]:
        if (found := pressures(indenter)) is None:
            return 0.0, 0.0
        x, y = found.about(force_n).centre_mm.tolist()
        return x, y

    return centre


def centre_of(contacts: Sequence[Contact]) -> tuple[float, float, float]:
    """The centre of the estimated contacts (mm), and their total force (N); the centre is NaN without force."""
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
        DatasetError: the presses do not suffice, or the calibrated field would be no better than its source.
        ConfigurationError: a body is wider than the gel.
    """
    bodies, source = pressed.bodies(loaded, dataset), loaded.model.readout
    assert isinstance(source, FieldReadout)
    require_presses(dataset, reached_mm(source.tips) if source.tips else (source.bins.width_mm, source.bins.height_mm))
    scaling, _, rows = pressed_gel((source.tips or source).scaling, dataset)
    fold = folds_of(dataset.presses[rows][:, [0, 1, 3]].astype(float))
    sensor = pressed.known_sensor(loaded)
    fit = fit_field(
        sensor, at_rest(scaling), dataset, rows, fold, bodies, progress, curve=curve,
        refinement=refinement_of(loaded, sensor),
    )  # fmt: skip
    assert fit.by is not None
    require_unit(fit.gain, forced=forced)
    offset_n, spread_n = fit.offset_n
    require_tared(offset_n, max(spread_n, BENT * float(np.median(fit.by.force_n))))
    before = Held.of([source] * len(fit.by), dataset, fit.by, np.zeros(len(fit.by), int)).errors
    contacts = np.column_stack([fit.by.centre_mm, fit.by.force_n])
    as_described = fit.form == 'description' and abs(math.log(fit.gain)) < CONFIRMED
    confirmed = as_described and loaded.of_description
    fault = fit.objection or objection('calibration', fit.errors, None if confirmed else before, of_the_mean(contacts))
    require_worth(fault, ADVICE, forced=forced)
    why = (
        f'presses of {bodies.card_name} contain no information on tips'
        if source.tips
        else 'the model has no readout for tips'
    )
    text = f'alone: {why}, which the field reads as any other contact; pressed by {bodies.card_name}'
    text += in_words(fit.looks) + fit.told_sides + fit.deep
    return Transfer(
        fit.readout, fit.form, fit.misfits, before, fit.errors, len(fit.by), offset_n, {'gain': fit.gain}, fault, text,
        fit.curve, fit.gives_px,
    )  # fmt: skip
