"""Presses by hand: pictures of the camera, and a table that says what is known of each. No rig, no bag.

A row of the table names a picture (beside the table) and tells x, y and the force, each left empty where nobody knows
it: `rest.png,,,0` is the gel untouched, `a.png,,,50` a weight of 50 g somewhere, `b.png,-8,3,` a pen.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from tactile_nodes import __version__, clock
from tactile_nodes.contact_tables.gel_tables import contact_table
from tactile_nodes.errors import ConfigurationError, DatasetError, ImageError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.agreement.rows import Row, require_seen, require_single
from tactile_nodes.learning.agreement.told import Told, require_agreement
from tactile_nodes.learning.calibrating.files import CALIBRATION, Source, require_source
from tactile_nodes.learning.config import Choice
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.evaluation.evaluate import config_of
from tactile_nodes.learning.field.alone import presses_tell_tips
from tactile_nodes.learning.field.body import BALL_MM, BODY, Bodies, KnownBody, as_ball, body_of_card
from tactile_nodes.learning.field.by_hand import alone_by_hand, with_field_by_hand
from tactile_nodes.learning.field.calibration import Pressed, kept
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import gel_told
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.learning.tables.pictures import picture_id, read_pictures
from tactile_nodes.learning.tables.presses import REACH_MM, PressTable, read_table
from tactile_nodes.learning.transfer.checks import source_readout
from tactile_nodes.learning.transfer.judgement import objection, of_the_mean, require_worth
from tactile_nodes.learning.transfer.partial import PartialTransfer, transfer_outline, transfer_partial
from tactile_nodes.model_file import LoadedModel, save_model
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.flow.dot_pattern import find_dots
from tactile_nodes.sensing.flow.dots import DotsFlow
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.picture.outline import OutlineMap, outline_map
from tactile_nodes.sensing.rest.reference import average
from tactile_nodes.simulation.optics import Optics

REST_SEED = 1
NO_PRESS = 'the table holds no press, all its forces are 0: nothing would tell how hard the gel is'

BodyOf = Callable[[str, bool], KnownBody]
"""What an indenter of a row is; told whether all rows have it."""


@dataclass(frozen=True)
class HandPresses:
    """Pictures of one gel: untouched, and pressed at `contacts` (x, y in mm, force in N; NaN where nobody knows).

    `indenters` are what pressed, by their names in the table.
    """

    rest: list[UInt8[np.ndarray, 'h w']]
    pressed: list[UInt8[np.ndarray, 'h w']]
    contacts: Float[np.ndarray, 'n 3']
    indenters: tuple[str, ...]
    fingerprint: str
    table: PressTable

    @classmethod
    def read(
        cls,
        table: Path,
        reach_mm: tuple[float, float] = REACH_MM,
        body_of: BodyOf | None = None,
        untouched_n: float = 0.0,
        known: Known | None = None,
    ) -> HandPresses:
        """A table and the pictures that it names; with `body_of` what pressed must be known; forces up to
        `untouched_n`, of either sign, are the gel untouched; `known` describes what was pressed.

        Raises:
            DatasetError: the table cannot be read or understood, or has no picture of the gel untouched.
            ConfigurationError: a picture cannot be read.
        """
        read = read_table(table, reach_mm, untouched_n)
        if read.of_video:
            raise DatasetError(f'{table} names no pictures; make a data set of a video: tactile dataset import')
        if body_of is not None:
            _require_bodies(read, body_of)
        known, faults = known or Known(), read.faults
        require_seen(read.rows, known.sensor, faults)
        faults.require_none()
        pictures = read_pictures(read, known.size)
        contacts = np.array([(row.x_mm, row.y_mm, row.force_n) for row in read.rows]).reshape(-1, 3)
        untouched = contacts[:, 2] == 0
        if not untouched.any():
            raise DatasetError(f'{table} has no picture of the gel untouched; add one with a force of 0, better twelve')
        digest = hashlib.sha256(contacts.tobytes() + b''.join(picture.tobytes() for picture in pictures))
        chosen: tuple[list[Any], list[Any]] = ([], [])
        for picture, at_rest in zip(pictures, untouched, strict=True):
            chosen[0 if at_rest else 1].append(picture)
        indenters = tuple(row.indenter for row in read.rows if row.touches)
        return cls(*chosen, contacts[~untouched], indenters, digest.hexdigest()[:16], read)

    @property
    def rest_picture(self) -> UInt8[np.ndarray, 'h w']:
        """The mean of the pictures of the gel untouched."""
        return average(self.rest)

    def dataset(self, measurer: Measurer) -> Dataset:
        """Features of all pictures against the mean of those untouched; a depth of 1 says that something touched."""
        measurer.use_reference(self.rest_picture)
        measured = [measurer.measure([picture]) for picture in (*self.rest, *self.pressed)]
        presses = np.zeros((len(measured), 4), np.float32)
        presses[: len(self.rest), 2] = -1.0
        presses[len(self.rest) :, 2] = 1.0
        presses[len(self.rest) :, [0, 1, 3]] = self.contacts
        return Dataset(
            np.stack([each.values for each in measured]), presses, np.arange(len(measured)),
            np.stack([each.confidence for each in measured]), self.fingerprint,
            indenter=np.array([''] * len(self.rest) + list(self.indenters)),
        )  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """All rows, with what their pictures are known by."""
        left = iter(self.rest), iter(self.pressed)
        return [Row(self.table, row, picture_id(next(left[row.touches]))) for row in self.table.rows]

    def shown(self, dataset: Dataset, encoding: str) -> Told:
        """What is told of the presses beside what their pictures show, by `dataset`."""
        rows = np.arange(len(self.rest), len(self.rest) + len(self.pressed))
        lines = [np.array([row.line for row in self.table.rows if row.touches == pressed], int) for pressed in (0, 1)]
        motion = as_motion(encoding, dataset.features.astype(np.float32))
        return Told(
            self.table.file, lines[1], self.contacts[:, :2], self.contacts[:, 2], motion[rows],
            dataset.confidence[dataset.rest[rows]], lines[0], motion[: len(self.rest)],
        )  # fmt: skip


def _require_bodies(table: PressTable, body_of: BodyOf) -> None:
    """Refuse rows whose indenter is no body.

    Raises:
        DatasetError: says which.
    """
    faults, pressed = table.faults, [row for row in table.rows if row.touches]
    alone = len({row.indenter for row in pressed}) == 1
    for row in pressed:
        with faults.row(row.line):
            body_of(row.indenter, alone)
    faults.require_none()


def source_rest(loaded: LoadedModel, like: UInt8[np.ndarray, 'h w']) -> UInt8[np.ndarray, 'h2 w2'] | None:
    """What the known gel looks like untouched: the model's rest image, or one of its simulated gel; None without."""
    if loaded.rest_image.size:
        return loaded.rest_image
    try:
        gel = config_of(loaded).gel
    except ConfigurationError:
        return None
    if gel.gel_id != loaded.card['gel'].get('id') or (gel.image_height, gel.image_width) != like.shape:
        return None
    return Optics(gel, contact_table(gel)).render((), REST_SEED)


def outline_between(loaded: LoadedModel, rest: UInt8[np.ndarray, 'h w']) -> OutlineMap | str:
    """How the gel's outline maps from the model's rest image to this one, or why that cannot be told."""
    known = source_rest(loaded, rest)
    if known is None:
        height, width = rest.shape
        return f'the model has no rest image of its gel in {width}x{height} pixels, as the pictures are'
    side = min(*known.shape, *rest.shape)
    if known.shape != rest.shape:
        known, rest = (np.ascontiguousarray(centre_crop(each, side, side)) for each in (known, rest))
    try:
        return outline_map(known, rest)
    except ImageError as error:
        return str(error)


def calibrate_by_hand(
    source: Source,
    table: Path,
    gel: str,
    output: Path,
    progress: Progress,
    command: str = '',
    pressed: Pressed | None = None,
    *,
    forced: bool = False,
    untouched_n: float = 0.0,
) -> tuple[str, PartialTransfer]:
    """Write the model of the gel that the table's pictures show; its id, and how it came about.

    With `forced` also one that reads held-out presses no better than the source, or than their mean. `pressed` is what
    a readout of any contact has to know, as its source says unless given. `untouched_n` as for `HandPresses.read`.

    Raises:
        ModelError: the model cannot be transferred, or is a calibration for this gel already.
        DatasetError: the pictures cannot be used, or the calibration would not pay.
        ImageError: a picture cannot be measured.
    """
    begun, told, loaded = clock.perf_ns(), gel_told(gel), source.loaded
    require_source(loaded, str(told['id']))
    bins = loaded.model.bins
    pressed, field = pressed or Pressed(), isinstance(loaded.model.readout, FieldReadout)

    @cache
    def body_of(indenter: str, alone: bool) -> KnownBody:
        return pressed.named(loaded, indenter, alone=alone)

    left, top = (abs(each) for each in bins.centre_mm)
    half_mm = left + bins.width_mm / 2, top + bins.height_mm / 2
    known = Known.of(loaded, pressed.sensor and pressed.known_sensor(loaded))
    presses = HandPresses.read(table, half_mm, body_of if field else None, untouched_n, known)
    progress.say(f'{table}: {presses.table.told}')
    _require_pattern(loaded, presses.rest_picture, forced=forced)
    require_single(presses.rows, progress, forced=forced)
    made, bodies, rest = _fitted(loaded, presses, pressed, known, progress, forced=forced)
    seconds = round((clock.perf_ns() - begun) / clock.NS_PER_S, 1)
    samples = len(presses.rest) + len(presses.pressed)
    card = {
        **kept(pressed.told(loaded.card, bodies), made.readout),
        'command': command,
        'made_with': f'tactile_nodes {__version__}',
        'licence': 'the same as tactile_nodes',
        'gel': told,
        'data': {
            'origin': CALIBRATION,
            'bags': [],
            'samples': samples,
            'fingerprint': presses.fingerprint,
            'pictures': [picture_id(picture) for picture in presses.pressed],
        },
        'source': source.told(output),
        'training': {'seconds': seconds, 'device': 'cpu', 'calibration': made.as_dict()},
    }
    return save_model(output, replace(loaded.model, readout=made.readout, model_id='unsaved'), card, rest), made


def _require_pattern(loaded: LoadedModel, rest: UInt8[np.ndarray, 'h w'], *, forced: bool) -> None:
    """Refuse printed dots for a model that follows a texture.

    Raises:
        DatasetError: that is so, and nobody forced it.
    """
    if loaded.flow[0] != DotsFlow.name and not forced and (dots := find_dots(rest)) is not None:
        raise DatasetError(
            f'the pictures show {len(dots.centres_px)} printed dots, and model {loaded.model_id} follows a texture; '
            'describe the sensor (tactile sensor new) and begin with a model of its description (docs/sensors.md); '
            '--force begins with this one all the same'
        )


def _cut_told(loaded: LoadedModel, presses: HandPresses, known: Known) -> str:
    """That not all of the pictures counts, in words; empty where all does, or their model was made of such ones."""
    height, width = presses.rest[0].shape
    image = known.sensor.image if known.sensor else None
    if (width, height) in (loaded.image_size, (image.width, image.height) if image else None):
        return ''
    across, down = loaded.image_size
    own = f', which is made for pictures of {image.width}x{image.height}' if image else ''
    return (
        f'the pictures have {width}x{height} pixels: the middle {min(across, width)}x{min(down, height)} of each '
        f'counts, by model {loaded.model_id}{own}'
    )


def _tips_told(loaded: LoadedModel, presses: HandPresses, bodies: Bodies | None) -> str:
    """That another tip pressed than the model knows, in words; empty where none did, or nobody tells."""
    if BODY in loaded.card or BALL_MM in loaded.card:
        own = body_of_card(loaded.card, loaded.model_id).told
    else:
        own = f'ball:{config_of(loaded).gel.tip_radius_mm:g}'
    names = [each.told for each in bodies.known] if bodies else list(map(as_ball, presses.indenters))
    if not (others := sorted({name for name in names if name.startswith('ball:')} - {own})):
        return ''
    return (
        f'{", ".join(others)} pressed, and model {loaded.model_id} knows tips as {own}: a blunter one reads as a '
        'softer and wider gel'
    )


def _fitted(
    loaded: LoadedModel, presses: HandPresses, pressed: Pressed, known: Known, progress: Progress, *, forced: bool
) -> tuple[PartialTransfer, Bodies | None, np.ndarray]:
    """The calibration, what pressed if a field was there to be fitted, and the rest image that it was measured against.

    Raises:
        DatasetError: no calibration follows, or it would not pay.
    """
    no_press = '' if presses.pressed else NO_PRESS
    require_worth(no_press, 'add five presses with a weight, or three with a pen at known places', forced=forced)
    outline = outline_between(loaded, presses.rest_picture)
    if isinstance(outline, str) and not presses.pressed:
        raise DatasetError(f'the table holds no press, and the outline of the gel cannot be used: {outline}')
    if isinstance(outline, str):
        progress.say(f'the outline of the gel is not used: {outline}')
    with Measurer(Choice(*loaded.flow), Choice(*loaded.encoding), loaded.image_size) as measurer:
        dataset = presses.dataset(measurer)
        half_px, rest = measurer.size[0] / 2, measurer.rest_image
    if said := _cut_told(loaded, presses, known):
        progress.say(said)
    require_agreement([presses.shown(dataset, loaded.encoding[0])], progress, known, forced=forced)
    bodies = pressed.bodies(loaded, dataset) if isinstance(loaded.model.readout, FieldReadout) else None
    if not presses_tell_tips(loaded, pressed, dataset):
        return alone_by_hand(loaded, dataset, pressed, progress, forced=forced), bodies, rest
    readout = source_readout(loaded)
    if said := _tips_told(loaded, presses, bodies):
        progress.say(said)
    if presses.pressed:
        seen = None if isinstance(outline, str) else outline
        made = transfer_partial(readout, dataset, seen, half_px, progress)
    else:
        assert isinstance(outline, OutlineMap)
        made = transfer_outline(readout, outline, half_px)
    made = with_field_by_hand(loaded, made, dataset, pressed, progress, forced=forced)
    said = objection('calibration', made.after, made.before, of_the_mean(presses.contacts)) or no_press
    require_worth(said, 'keep the model, or check the table and take more pictures', forced=forced)
    return replace(made, objection=made.objection or said), bodies, rest
