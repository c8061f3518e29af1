"""The images of a table's rows: files of a folder, moments of a video, or rows of an array."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tactile_nodes.drivers.camera.contract import Picture
from tactile_nodes.drivers.camera.file import VideoFile
from tactile_nodes.drivers.camera.pictures import read_grey
from tactile_nodes.errors import DatasetError
from tactile_nodes.files import PICTURE_BYTES, check_size
from tactile_nodes.learning.tables.faults import RowFaults
from tactile_nodes.learning.tables.presses import PressTable, TablePress
from tactile_nodes.paths import is_file
from tactile_nodes.sensing.geometry import grey
from tactile_nodes.sensors import Sensor

Size = tuple[int, int]


class Pictures(Protocol):
    """Grey images by rows."""

    def require(self, rows: Sequence[TablePress], faults: RowFaults) -> None:
        """Store a fault for each row without image, as far as this is known without reading images."""
        ...

    def of(self, rows: Sequence[TablePress], faults: RowFaults) -> Iterator[tuple[TablePress, Picture]]:
        """Each row with its image, (h, w), one in memory at a time. A fault is stored for each row without image."""
        ...


@dataclass(frozen=True)
class FolderPictures:
    """Files of a folder."""

    folder: Path

    def require(self, rows: Sequence[TablePress], faults: RowFaults) -> None:
        for row in rows:
            with faults.row(row.line):
                if not row.picture:
                    raise DatasetError('names no image; times need a video, given with --pictures')
                file = self.folder / row.picture
                try:
                    check_size(file, PICTURE_BYTES)
                except OSError as error:
                    meant = '' if len(faults) else _alike(file)  # only the first fault is shown in full
                    raise DatasetError(f'cannot read the image {file} ({error.strerror}){meant}') from error

    def of(self, rows: Sequence[TablePress], faults: RowFaults) -> Iterator[tuple[TablePress, Picture]]:
        for row in rows:
            with faults.row(row.line):
                yield row, read_grey(self.folder / row.picture)


def _alike(missing: Path) -> str:
    """Names a file that is probably meant: capitals or ending differ, accents as macOS stores them, a backslash."""
    wanted = missing.parent / missing.name.replace('\\', '/')
    try:
        there = sorted(wanted.parent.iterdir())
    except OSError:
        return ''
    found = next((each for each in there if {*_names(each)} & {*_names(wanted)}), None)
    return f'; there is {found}: write its name in the table as it is' if found else ''


def _names(file: Path) -> list[str]:
    """A file's name with and without its ending, in one spelling."""
    return [unicodedata.normalize('NFC', name).casefold() for name in (file.name, file.stem)]


@dataclass(frozen=True)
class VideoPictures:
    """Frames of a video, the nearest to each time. Phones vary the frame rate, so the times of the frames count."""

    file: Path

    def require(self, rows: Sequence[TablePress], faults: RowFaults) -> None:
        for row in rows:
            with faults.row(row.line):
                if row.picture:
                    raise DatasetError(
                        f'names the image {row.picture}, but {self.file} is a video; write a column time_s'
                    )

    def of(self, rows: Sequence[TablePress], faults: RowFaults) -> Iterator[tuple[TablePress, Picture]]:
        video = VideoFile(self.file, 0.0)
        video.start()
        try:
            frames = _timed(video)
            shown, after = next(frames, None), next(frames, None)
            for row in sorted(rows, key=lambda each: each.time_s):
                while shown and after and after[0] - row.time_s < row.time_s - shown[0]:
                    shown, after = after, next(frames, None)
                with faults.row(row.line):
                    if shown is None or (row.time_s > shown[0] + 0.5 / video.fps and after is None):
                        ends_s = shown[0] + 1 / video.fps if shown else 0.0
                        raise DatasetError(f'time {row.time_s:g} s: {self.file} ends at {ends_s:g} s')
                    yield row, grey(shown[1])
        finally:
            video.stop()


def _timed(video: VideoFile) -> Iterator[tuple[float, Picture]]:
    """Each frame of an open video with its time."""
    while (frame := video.next()) is not None:
        yield video.time_s, frame


@dataclass(frozen=True)
class ArrayPictures:
    """Images as an array, (n, h, w) or (n, h, w, 3), of bytes. Row k of a table has image k."""

    images: Any
    order: str = 'rgb'

    def require(self, rows: Sequence[TablePress], faults: RowFaults) -> None:
        """No image can be missing."""

    def of(self, rows: Sequence[TablePress], faults: RowFaults) -> Iterator[tuple[TablePress, Picture]]:
        for row in rows:
            with faults.row(row.line):
                yield row, grey(np.asarray(self.images[row.line]), self.order)


def beside(named: Iterable[tuple[Pictures, Sequence[TablePress]]]) -> list[Path]:
    """Images that no row names, in the folders of those that rows name, with the same endings."""
    files = {
        pictures.folder / row.picture
        for pictures, rows in named if isinstance(pictures, FolderPictures)
        for row in rows
    }  # fmt: skip
    alike = {(file.parent, file.suffix) for file in files}
    folders = [folder for folder in {folder for folder, _ in alike} if os.access(folder, os.R_OK)]
    there = {each for folder in folders for each in folder.iterdir() if each.name[0] != '.'}
    return sorted(each for each in there - files if (each.parent, each.suffix) in alike)


def folder_of(table: PressTable) -> Path:
    """The folder of a table's images: the table's own, or the only folder beside it that has the first image."""
    parent = table.file.parent
    first = next((row.picture for row in table.rows if row.picture), '')
    if not first or is_file(parent / first):
        return parent
    having = [each for each in parent.iterdir() if is_file(each / first)]  # a folder may be closed to this user
    return having[0] if len(having) == 1 else parent


def pictures_of(table: PressTable, source: Path | None) -> Pictures:
    """The location of a table's images: beside it, in another folder, or in a video.

    Raises:
        DatasetError: rows give times, and no video is given.
    """
    if source is None and table.of_video:
        raise DatasetError(f'{table.file} has times and no images; name the video with --pictures')
    if source is None or source.is_dir():
        return FolderPictures(source or folder_of(table))
    return VideoPictures(source)


@dataclass
class OneSize:
    """Requires images to have the size of the first one, or of a sensor's description."""

    size: Size | None = None
    said_by: str = ''

    @classmethod
    def of(cls, sensor: Sensor | None) -> OneSize:
        """The size in a sensor's description, if there is one."""
        return cls((sensor.image.width, sensor.image.height), 'the description of the sensor') if sensor else cls()

    def require(self, table: PressTable, row: TablePress, picture: Picture) -> None:
        """Refuse an image of another size. Raises DatasetError."""
        height, width = picture.shape
        if self.size is None:
            self.size, self.said_by = (width, height), f'that of {table.counted} {row.line} of {table.file}'
        if (width, height) != self.size:
            wanted = 'x'.join(map(str, self.size))
            name = f'image {row.picture}' if row.picture else f'the image at {row.time_s:g} s'
            raise DatasetError(
                f'{name} has {width}x{height} pixels, but {self.said_by} has {wanted}; '
                'use one camera setting for all, and describe that one'
            )
