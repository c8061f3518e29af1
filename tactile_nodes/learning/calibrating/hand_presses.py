"""Presses by hand: images of the camera, and a table that describes each. No rig, no bag.

A row of the table names an image and gives x, y and the force: `a.png,-8,3,50` is a weight of 50 g on a mark,
`rest.png,,,0` the untouched gel. They become a data set, with the features of the model that is to be calibrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.calibrating.files import require_source
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.evaluation.evaluate import config_of
from tactile_nodes.learning.field.body import BALL_MM, BODY, as_ball, body_of_card
from tactile_nodes.learning.field.calibration import Pressed
from tactile_nodes.learning.imported.importing import Imported, import_presses, require_rows
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import BuildOptions
from tactile_nodes.learning.tables.pictures import FolderPictures, folder_of
from tactile_nodes.learning.tables.presses import PressTable, TablePress, read_table
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.sensing.explain.field.readout import FieldReadout


def presses_by_hand(
    loaded: LoadedModel,
    table: Path,
    gel: str,
    progress: Progress,
    command: str = '',
    pressed: Pressed | None = None,
    *,
    forced: bool = False,
    untouched_n: float = 0.0,
    indenter: str = '',
) -> RecordedPresses:
    """The data set of a table and its images, to calibrate a model with.

    `pressed` is the sensor and body for a readout of any contact, by default those of the model. Forces up to
    `untouched_n`, of either sign, count as the untouched gel. `forced` also accepts a table that its images contradict.
    `indenter` is the one whose presses will be chosen, so that others need no body; empty: all.

    Raises:
        ModelError: the model cannot be transferred, or is a calibration for this gel already.
        DatasetError: the table cannot be read or understood, or its images cannot be used.
        ConfigurationError: a sensor with other bins than the model.
    """
    options, pressed = BuildOptions.of_model(loaded, gel, 'each'), pressed or Pressed()
    require_source(loaded, str(options.gel['id']))
    known = Known.of(loaded, pressed.sensor and pressed.known_sensor(loaded))
    read = read_table(table, options.bins.reach_mm, untouched_n)
    if read.of_video:
        raise DatasetError(f'{table} names no images; make a data set from a video: tactile dataset import')
    touching = [row for row in read.rows if row.touches and indenter in ('', row.indenter)]
    if isinstance(loaded.model.readout, FieldReadout):
        _require_bodies(read, touching, loaded, pressed)
    source = Imported(read, FolderPictures(folder_of(read)))
    require_rows(source, known.sensor)
    if sentence := _describe_tips(loaded, touching, pressed):
        progress.say(sentence)
    return import_presses([source], options, known, progress, command=command, forced=forced)


def _require_bodies(table: PressTable, rows: Sequence[TablePress], loaded: LoadedModel, pressed: Pressed) -> None:
    """Refuse those rows whose indenter is no body.

    Raises:
        DatasetError: says which.
    """
    faults = table.faults
    named = cache(partial(pressed.named, loaded, alone=len({row.indenter for row in rows}) == 1))
    for row in rows:
        with faults.row(row.line):
            named(row.indenter)
    faults.require_none()


def _describe_tips(loaded: LoadedModel, rows: Sequence[TablePress], pressed: Pressed) -> str:
    """A note that another tip pressed than in the model's training; empty if none did, or if it is unknown."""
    readout = loaded.model.readout
    names = {pressed.body.name} if pressed.body else {as_ball(row.indenter) for row in rows}
    if isinstance(readout, FieldReadout) and (readout.tips is None or len(names) > 1):
        return ''  # no tip is calibrated
    if BODY in loaded.card or BALL_MM in loaded.card:
        own = body_of_card(loaded.card, loaded.model_id).name
    else:
        own = f'ball:{config_of(loaded).gel.tip_radius_mm:g}'
    if not (others := sorted({name for name in names if name.startswith('ball:')} - {own})):
        return ''
    return (
        f'{", ".join(others)} pressed, but model {loaded.model_id} was trained with {own}: a blunter tip reads as '
        'a softer and wider gel'
    )
