"""Builds a data set from tables of presses with images, checked and measured in the same way as a rig's bags.

A row becomes the message that a rig would have sent, with NaN for unknown values such as depth and steadiness.
Consecutive rows with the same place, forces, torques, depth and indenter are images of one press.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.conversions import header
from tactile_nodes.drivers.camera.contract import Picture
from tactile_nodes.errors import DatasetError, ImageError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.agreement.stated_presses import (
    Row,
    StatedPresses,
    require_agreement,
    require_seen,
    require_single,
)
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.bags import Frame, RecordedPress
from tactile_nodes.learning.recorded.building import Builder, BuildOptions
from tactile_nodes.learning.recorded.gels import Gels
from tactile_nodes.learning.recorded.measuring import Measurer
from tactile_nodes.learning.tables.faults import RowFaults
from tactile_nodes.learning.tables.pictures import OneSize, Pictures, Size, beside
from tactile_nodes.learning.tables.presses import PressTable, TablePress
from tactile_nodes.messages import time_from_ns, types
from tactile_nodes.sensing.features import as_motion
from tactile_nodes.sensing.flow.dot_pattern import find_dots
from tactile_nodes.sensing.flow.dots import DotsFlow
from tactile_nodes.sensing.flow.methods import FlowMethod
from tactile_nodes.sensing.picture.quality import require_picture
from tactile_nodes.sensing.rest.reference import average, content_id
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float32

LONG_SERIES = 4
"""So many images of the untouched gel in succession suffice for a rest image."""

UNTOUCHED = 0.5
"""All images of the untouched gel are divided among the presses. `frames` determines how many of each part are used."""


ONE_FIGURE = 1
"""One image beside those of the rows is a figure, as `next.png` of guided presses."""


@dataclass(frozen=True)
class Imported:
    """A table, and the location of its images."""

    table: PressTable
    pictures: Pictures


def import_presses(
    sources: Sequence[Imported],
    options: BuildOptions,
    known: Known | None = None,
    progress: Progress | None = None,
    *,
    command: str = '',
    forced: bool = False,
) -> RecordedPresses:
    """The data set of some tables, each measured against the mean of its own images of the untouched gel.

    Tables of two gels are only warned of.

    Args:
        sources: tables with their images; each may have its own indenters.
        options: how images become samples.
        known: the description of the pressed sensor, which images must match; without it, they must be of one size.
        progress: shows how the columns of each table were interpreted, and warnings.
        command: the command line.
        forced: accept a table whose places or forces contradict its images.

    Raises:
        DatasetError: a row or an image cannot be used, or table and images contradict each other; says in which row.
        ConfigurationError: an option that cannot be used.
    """
    progress, options, known = progress or Progress(), replace(options, without_contact=UNTOUCHED), known or Known()
    for source in sources:
        progress.say(f'{source.table.file}: {source.table.description}')
        require_rows(source, known.sensor)
        if again := _repeated(source.table.rows):
            progress.say(
                f'{source.table.file}: presses with the values of an earlier one: {again}. If they are pictures of one '
                'press, put their rows one after the other: a split keeps only those together'
            )
    if len(unnamed := beside((each.pictures, each.table.rows) for each in sources)) > ONE_FIGURE:
        progress.say(f'images that no row names: {len(unnamed)}, such as {unnamed[0]} and {unnamed[-1]}')
    entries, rests, rows = [], [], []
    with (
        Measurer(options.flow, options.encoding, options.crop) as measurer,
        progress.bar('reading presses', sum(len(_presses(each.table.rows)) for each in sources)) as bar,
    ):
        builder, size, gels = Builder(options, measurer, bar), known.size, Gels(progress)
        for number, source in enumerate(sources):
            card, rest_motion, known_rows = _taken(builder, number, source, size, forced=forced)
            gels.see(source.table.file, measurer)
            entries.append(card)
            rests.append(rest_motion)
            rows += known_rows
        _tell_cut(size.size, measurer.size, known.sensor, progress)
    require_single(rows, progress, forced=forced)
    presses = builder.recordings(entries, [source.table.file for source in sources], command=command)
    shown = [_shown(presses, number, source.table, rests[number]) for number, source in enumerate(sources)]
    require_agreement(shown, progress, known, forced=forced)
    return presses


def _tell_cut(size: Size | None, used: Size, sensor: Sensor | None, progress: Progress) -> None:
    """Say that only a part of the images is used, unless a description of such images says which."""
    if size and size not in (used, sensor and (sensor.image.width, sensor.image.height)):
        (width, height), (across, down) = size, used
        progress.say(
            f'the images have {width}x{height} pixels, of which the middle {min(across, width)}x{min(down, height)} '
            'are used; a description of the sensor can use all (docs/sensors.md)'
        )


def _shown(presses: RecordedPresses, number: int, table: PressTable, rest_motion: np.ndarray) -> StatedPresses:
    """The presses of one table, and what their images show."""
    rests = np.array([row.line for row in table.rows if not row.touches])
    rows = np.flatnonzero(presses.contact & (presses.bag == number))
    lines_of = {group[0].line: [row.line for row in group] for group in _presses(table.rows)}
    first = presses.window_ns[rows, 0] // NS_PER_S
    lines = [
        lines_of[line][picture]
        for line, picture in zip(first.tolist(), (presses.stamp_ns[rows] // NS_PER_S - first).tolist(), strict=True)
    ]
    return StatedPresses(
        table.file, np.array(lines, np.int64), presses.position_mm[rows], presses.force_n[rows],
        as_motion(presses.card['encoding']['name'], presses.features[rows].astype(np.float32)),
        presses.confidence[presses.confidence_row[rows]], rests, rest_motion, table.counted,
    )  # fmt: skip


def require_rows(source: Imported, sensor: Sensor | None = None) -> None:
    """Refuse a table that cannot become a data set, before any image is read. `sensor` is the sensor's description.

    Raises:
        DatasetError: says in which rows.
    """
    table, faults = source.table, source.table.faults
    for row in table.rows:
        with faults.row(row.line):
            if row.touches and not np.isfinite((row.x_mm, row.y_mm, row.force_n)).all():
                raise DatasetError(
                    'a press needs x, y and force: put a known weight on a mark, or leave the row out; if it shows the '
                    'untouched gel, its force is 0, or noise of a gauge: --untouched-below N'
                )
    require_seen(table.rows, sensor, faults)
    source.pictures.require(table.rows, faults)
    faults.require_none()
    forces = {row.force_n for row in table.rows if row.touches}
    if all(row.touches for row in table.rows):
        raise DatasetError(f'{table.file} has no image of the untouched gel; add one with a force of 0, better twelve')
    if len(forces) < 2:
        tells = f'has one force for all presses, {min(forces):g} N' if forces else 'has no press, all forces are 0'
        raise DatasetError(f'{table.file} {tells}: press with at least two weights')


def _ordered(rows: Sequence[TablePress]) -> Sequence[TablePress]:
    """The rows in the order of their images: those of a video by time, others as in the table."""
    return sorted(rows, key=lambda row: row.time_s) if all(not row.picture for row in rows) else rows


def _presses(rows: Sequence[TablePress]) -> list[list[TablePress]]:
    """Rows of each press, in order."""
    return [list(group) for held, group in groupby(_ordered(rows), lambda row: (row.touches, row.held)) if held[0]]


class _Part(NamedTuple):
    """Rows of successive presses, and those of the untouched gel right before them."""

    rests: list[TablePress]
    presses: list[list[TablePress]]


def _parts(rows: Sequence[TablePress]) -> list[_Part]:
    """The rows in parts. Presses at the beginning count to the first rest images after them, rest images at the end to
    the last presses."""
    parts = [_Part([], [])]
    for touches, group in groupby(_ordered(rows), lambda row: row.touches):
        if touches:
            parts[-1].presses.extend(_presses(list(group)))
        elif parts[-1].rests:
            parts.append(_Part(list(group), []))
        else:
            parts[-1].rests.extend(group)
    if len(parts) > 1 and not parts[-1].presses:
        last = parts.pop()
        parts[-1].rests.extend(last.rests)
    return parts


class _Press(NamedTuple):
    """Rows of a press, those of the untouched gel right before it, and those of them that count as its samples."""

    rows: list[TablePress]
    before: list[TablePress]
    untouched: list[TablePress]


def _rest_image(parts: Sequence[_Part], picture_of: Mapping[int, Picture]) -> Picture:
    """The mean of the longest series of rest images, or of all if that is short: the camera may move between two."""
    longest = max((part.rests for part in parts), key=len)
    rests = longest if len(longest) >= LONG_SERIES else [row for part in parts for row in part.rests]
    return average([picture_of[row.line] for row in rests])


def _repeated(rows: Sequence[TablePress]) -> int:
    """The number of presses that have the same values as an earlier one, with other rows between them."""
    held = [press[0].held for press in _presses(rows)]
    return len(held) - len(set(held))


def _taken(
    builder: Builder, bag: int, source: Imported, size: OneSize, *, forced: bool
) -> tuple[dict[str, Any], Float32[np.ndarray, 'rests rows cols 2'], list[Row]]:
    """Give a table's presses to a builder.

    Returns the card's entry of the table, the motion in its images of the untouched gel, and its rows.
    """
    table, faults, measurer = source.table, source.table.faults, builder.measurer
    pressed: list[str] = []
    rested = list(_checked(source, [row for row in table.rows if not row.touches], size, faults))
    known = [Row(table, row, content_id(picture)) for row, picture in rested]
    faults.require_none()
    parts, picture_of = _parts(table.rows), {row.line: picture for row, picture in rested}
    plan = hashlib.sha256(repr((table.rows, [each.picture for each in known])).encode()).hexdigest()[:12]
    reference = Frame(0, _rest_image(parts, picture_of))
    if not forced:
        _require_pattern(table, measurer.flow, reference.image)
    moved: dict[int, np.ndarray] = {}
    try:
        measurer.use_reference(reference.image)
    except ImageError as error:
        raise DatasetError(f'{table.file}: {error}') from error
    for part in parts:
        with faults.row(part.rests[0].line, (ImageError,)):
            measurer.look_before([picture_of[row.line] for row in part.rests])
            moved |= {row.line: measurer.measure([picture_of[row.line]]).values for row in part.rests}
    faults.require_none()
    presses = [
        _Press(rows, part.rests, part.rests[number :: len(part.presses)])
        for part in parts
        for number, rows in enumerate(part.presses)
    ]
    at_rest = {line: Frame(reference.stamp_ns, picture) for line, picture in picture_of.items()}
    number_of = {row.line: number for number, press in enumerate(presses) for row in press.rows}
    pictures = _checked(source, [row for press in presses for row in press.rows], size, faults)
    for number, group in groupby(pictures, lambda pair: number_of[pair[0].line]):
        pairs, press = list(group), presses[number]
        frames = [picture for _, picture in pairs]
        if faults:
            continue  # the remaining rows are still checked for faults
        known += [Row(table, row, content_id(picture)) for row, picture in pairs]
        pressed += map(content_id, frames)
        untouched, before = ([at_rest[row.line] for row in rows] for rows in (press.untouched, press.before))
        builder.take(bag, _recorded(plan, number, press.rows[0], frames, untouched, before, reference))
    faults.require_none()
    name = hashlib.sha256(''.join([plan, *pressed]).encode()).hexdigest()[:12]
    card = {
        'id': name, 'gel': builder.options.gel['id'], 'attempts': len(presses), 'problems': [], 'clocks': [],
        'columns': table.description, 'pictures': pressed,
    }  # fmt: skip
    motion = np.stack([moved[line] for line in picture_of]).astype(np.float32)
    return card, as_motion(measurer.encoding.name, motion), known


def _require_pattern(table: PressTable, flow: FlowMethod, rest: Picture) -> None:
    """Refuse images of printed dots for a flow method that follows a texture. Raises DatasetError."""
    if flow.name != DotsFlow.name and (dots := find_dots(rest)) is not None:
        raise DatasetError(
            f'{table.file}: the images show {len(dots)} printed dots, but {flow.name} tracks a texture; describe the '
            'sensor (tactile sensor new), and give --model a model of its description (docs/sensors.md); --force '
            'measures the texture all the same'
        )


def _checked(
    source: Imported, rows: Sequence[TablePress], size: OneSize, faults: RowFaults
) -> Iterator[tuple[TablePress, Picture]]:
    """Rows with their images, except rows with a fault."""
    for row, picture in source.pictures.of(rows, faults):
        with faults.row(row.line):
            size.require(source.table, row, picture)
            require_picture(picture)
            yield row, picture


def _recorded(
    plan: str,
    number: int,
    row: TablePress,
    pictures: Sequence[Picture],
    untouched: Sequence[Frame],
    before: Sequence[Frame],
    reference: Frame,
) -> RecordedPress:
    """A press in the form that a rig would report. Its time is unknown: row k is set to second k."""
    begin_ns = row.line * NS_PER_S
    frames = [Frame(begin_ns + each * NS_PER_S, picture) for each, picture in enumerate(pictures)]
    (fx, fy), (tx, ty, tz), unknown = row.shear_n, row.torque_nm, float('nan')
    message = types.Press(
        header=header(begin_ns, 'gel_surface'),
        plan_id=plan,
        press=number + 1,
        attempt=1,
        position=types.Point(x=row.x_mm * 1e-3, y=row.y_mm * 1e-3),
        depth=row.depth_mm * 1e-3,
        depth_reported=unknown,
        indenter=row.indenter,
        window_start=time_from_ns(begin_ns),
        window_end=time_from_ns(frames[-1].stamp_ns + 1),
        frames=len(frames),
        wrench=types.Wrench(
            force=types.Vector3(x=fx, y=fy, z=-row.force_n), torque=types.Vector3(x=tx, y=ty, z=tz)
        ),
        wrench_deviation=types.Wrench(force=types.Vector3(z=unknown)),
        force_rate=unknown,
        status=types.Press.STATUS_RECORDED,
    )  # fmt: skip
    return RecordedPress(message, tuple(frames), tuple(untouched), tuple(before), reference, len(frames))
