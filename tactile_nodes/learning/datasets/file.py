"""The file of a data set: arrays and a card in one numpy .npz, without anything executable.

``numpy.load(file, allow_pickle=False)`` opens it anywhere. The entry ``card`` is JSON that describes the arrays and
their origin. The entry ``fingerprint`` covers every array and all of the card that affects them.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.files import bytes_there, open_plain
from tactile_nodes.learning.datasets.recordings import (
    OPTIONAL,
    REST_IMAGE,
    RecordedPresses,
    array_names,
    fingerprint_of,
)
from tactile_nodes.model_file import size_of_crop
from tactile_nodes.paths import write_whole
from tactile_nodes.sensing.geometry import BinGrid

FORMAT = 'tactile_nodes.dataset'
FORMAT_VERSION, OLDEST_VERSION = 2, 1
"""Files of version 1, and files of earlier releases with texture gains, are still read; the gains are dropped."""

_KINDS = {'f': ('features', 'labels', 'confidence', 'position_mm', 'depth_mm', 'depth_reported_mm', 'force_n',
                'force_rate_n_per_s', 'wrench', 'wrench_deviation'),
          'b': ('contact',), 'U': ('reference_id', 'tare_id')}  # fmt: skip
TEXTURE_GAINS = 'texture_gains'
_NAMES = {'card', 'fingerprint', *array_names(), *OPTIONAL, TEXTURE_GAINS}
_ZIP = b'PK'
_HOW = 'make one from bags with: tactile dataset build, or from pictures and a table with: tactile dataset import'
_LARGEST_RATIO = 20  # files are not compressed here; a user who compresses one gains less than this
_LARGEST_LIST = 1 << 20
_SHAPES = {
    'features': 4,
    'labels': 2,
    'confidence': 3,
    'position_mm': 2,
    'wrench': 2,
    'wrench_deviation': 2,
    'window_ns': 2,
}


def save_dataset(path: Path, presses: RecordedPresses) -> str:
    """Write the file and return its fingerprint. Equal content gives equal bytes.

    Raises:
        ConfigurationError: no file can be written there.
        DatasetError: writing failed, for example on a full disk.
    """
    card = json.dumps(dict(presses.card), sort_keys=True)
    arrays: dict[str, Any] = {'card': np.array(card), 'fingerprint': np.array(presses.fingerprint), **presses.arrays()}
    content = io.BytesIO()
    np.savez(content, **arrays)
    try:
        write_whole(path, content.getvalue())
    except OSError as error:
        raise DatasetError(f'cannot write the data set {path} ({error.strerror}); choose another place') from error
    return presses.fingerprint


def load_dataset(path: Path | str) -> RecordedPresses:
    """Read a file and check every byte of it.

    Raises:
        DatasetError: it is missing, damaged, no data set of this project, or of a newer format.
    """
    path = Path(path)
    entries = _entries(path)
    if 'card' not in entries or 'fingerprint' not in entries:
        raise DatasetError(f'{path} is not a data set of tactile_nodes; {_HOW}')
    try:
        card = json.loads(str(entries.pop('card')))
        fingerprint = str(entries.pop('fingerprint'))
        version = card['format_version'] if card['format'] == FORMAT else None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DatasetError(_damaged(path)) from error
    if version not in range(OLDEST_VERSION, FORMAT_VERSION + 1):
        raise DatasetError(
            f'the format of {path} has version {version}, but this release reads {OLDEST_VERSION} to {FORMAT_VERSION}; '
            'use the release that made it, or build the data set again'
        )
    known = set(entries) - {*OPTIONAL, TEXTURE_GAINS} == set(array_names())
    if not known or fingerprint_of(entries, card) != fingerprint or not _fit(entries, card):
        raise DatasetError(_damaged(path))
    entries.pop(TEXTURE_GAINS, None)
    return RecordedPresses(**entries, card=card)


def _entries(path: Path) -> dict[str, Any]:
    try:
        with open_plain(path) as opened:  # numpy does not close a file that it opened itself and cannot read
            _check_entries(path, opened)
            with np.load(opened, allow_pickle=False) as loaded:
                return {name: loaded[name] for name in loaded.files}
    except FileNotFoundError as error:
        raise DatasetError(f'there is no data set {path}; {_HOW}') from error
    except OSError as error:
        raise DatasetError(f'cannot read the data set {path} ({error.strerror or error}); {_HOW}') from error
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, KeyError, SyntaxError, MemoryError,
            NotImplementedError, RuntimeError) as error:  # fmt: skip
        raise DatasetError(_damaged(path)) from error


def _check_entries(path: Path, opened: BinaryIO) -> None:
    """Check names and sizes before unpacking: a file of 6 MB may unpack to 6 GB."""
    if opened.read(len(_ZIP)) != _ZIP:
        raise DatasetError(f'{path} is not a data set of tactile_nodes (.npz); {_HOW}')
    with zipfile.ZipFile(_Sparing(opened)) as archive:
        entries = archive.infolist()
    opened.seek(0)
    if foreign := {entry.filename for entry in entries} - {f'{name}.npy' for name in _NAMES}:
        raise DatasetError(f'{path} is not a data set of tactile_nodes: it holds {sorted(foreign)[0]!r:.60}')
    unpacked, packed = sum(entry.file_size for entry in entries), sum(entry.compress_size for entry in entries)
    stored = min(packed, bytes_there(opened, packed))  # sizes in entries may be false, and a sparse file has holes
    if unpacked > _LARGEST_RATIO * stored:
        raise DatasetError(
            f'{path} would unpack from {stored} to {unpacked} bytes, more than any data set; download it again'
        )


class _Sparing:
    """A file for `zipfile` that lets it read a list of entries, but not gigabytes that claim to be one."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell = file.seek, file.tell

    def read(self, size: int = -1) -> bytes:
        if size > _LARGEST_LIST:
            raise zipfile.BadZipFile('its list of entries is too long')
        return self._file.read(size)


def _fit(arrays: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> bool:
    """Whether the arrays have matching types and shapes."""
    count = len(arrays['force_n']) if arrays['force_n'].ndim else 0
    for name, array in arrays.items():
        if name in (*OPTIONAL, TEXTURE_GAINS):
            if array.dtype != (np.uint8 if name == REST_IMAGE else np.float32) or array.ndim != 2:
                return False
            continue
        kinds = next((kind for kind, names in _KINDS.items() if name in names), 'iu')
        if array.dtype.kind not in kinds or array.ndim != _SHAPES.get(name, 1):
            return False
        if name != 'confidence' and len(array) != count:
            return False
    try:
        labels = card['labels']
        bins = BinGrid.of_card(labels)
        sizes = {name: len(card[f'{name}s']) for name in ('bag', 'plan', 'indenter')}
        entries = [
            card['flow']['options'],
            card['encoding']['options'],
            card['gel']['id'],
            card['left_out'],
        ]
        crop = size_of_crop(card['crop_px'])
    except (KeyError, TypeError, ValueError):
        return False
    indices = [(arrays[name], size) for name, size in sizes.items()]
    indices.append((arrays['confidence_row'], len(arrays['confidence'])))
    return (
        count > 0
        and [type(each) for each in entries] == [dict, dict, str, list]
        and min(crop) > 0
        and arrays['labels'].shape[1] == bins.count
        and arrays['features'].shape[1:3] == arrays['confidence'].shape[1:]
        and [arrays[name].shape[1] for name in ('position_mm', 'wrench', 'wrench_deviation', 'window_ns')]
        == [2, 6, 6, 2]
        and all(int(index.min()) >= 0 and int(index.max()) < size for index, size in indices)
    )


def _damaged(path: Path) -> str:
    return f'{path} is damaged or not a data set: its fingerprint is wrong; build it again from the bags'
