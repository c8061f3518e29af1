"""Trained models as files: weights and a card in one safetensors file, which cannot contain code.

Any reader of the safetensors format opens the file. Its metadata hold the card as one JSON text, which says what the
numbers mean and how they were made. They also hold the SHA-256 of the whole file, computed with zeros in place of its
own digits, so that every altered byte is detected. The model id is its first 12 digits.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from tactile_nodes.errors import ConfigurationError, ModelError, in_a_line
from tactile_nodes.files import TEXT_BYTES, read_plain
from tactile_nodes.paths import check_output, is_file, share_directory, write_whole
from tactile_nodes.sensing.explain.arrays import readout_arrays, readout_from
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceModel
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import UInt8

FORMAT = 'tactile_nodes.force_model'
FORMAT_VERSION, LAYERED_VERSION, SMEARED_VERSION, FIELD_VERSION = 2, 3, 5, 6
"""Readouts that earlier releases would misread have their own versions.

Axisymmetric models without radial smear were written as version 4; those files can still be read.
"""
DESCRIPTION = 'description'
"""The data origin of a model that was computed without any press."""

SENSOR = 'sensor'
"""The entry of a card with the sensor description that the model was computed from."""

NO_CHECKSUM = '0' * 64
REST_IMAGE = 'rest_image'
LARGEST_BYTES = 1 << 30
"""Size limit of a model file; shipped models have 3 to 8 MB."""
NO_IMAGE = np.zeros((0, 0), np.uint8)


@dataclass(frozen=True)
class LoadedModel:
    """A model ready for use, its card, and the rest image of its calibration, if there is one.

    Without a rest image in the file, the array has no rows.
    """

    model: ForceModel
    card: Mapping[str, Any]
    rest_image: UInt8[np.ndarray, 'h w'] = field(default_factory=lambda: NO_IMAGE)

    @property
    def model_id(self) -> str:
        return self.model.model_id

    @property
    def flow(self) -> tuple[str, dict[str, object]]:
        """Name and options of the optical flow that the model was trained with."""
        return self.card['flow']['name'], dict(self.card['flow']['options'])

    @property
    def encoding(self) -> tuple[str, dict[str, object]]:
        """Name and options of the feature encoding that the model was trained with."""
        return self.card['encoding']['name'], dict(self.card['encoding']['options'])

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels of the images that the model was trained on."""
        return size_of_crop(self.card['crop_px'])

    @property
    def of_description(self) -> bool:
        """Whether it was computed from a sensor description alone and never compared with a force."""
        return bool(self.card.get('data', {}).get('origin') == DESCRIPTION)

    @property
    def gel(self) -> str:
        """The id of the gel that the model was trained on."""
        return str(self.card['gel']['id'])


def size_of_crop(crop_px: int | Sequence[int]) -> tuple[int, int]:
    """Width and height of images, px, from ``crop_px`` of a card: the side of a square, or both."""
    width, height = crop_px if isinstance(crop_px, Sequence) else (crop_px, crop_px)
    return int(width), int(height)


def crop_of_size(size: tuple[int, int]) -> int | list[int]:
    """The ``crop_px`` of a card for images of this width and height, px."""
    return size[0] if size[0] == size[1] else list(size)


def find_model(name: str) -> Path:
    """The file of a model: a path, or the name of a shipped model ('paper').

    Raises:
        ModelError: there is none; the message lists the shipped ones.
    """
    if shipped := shipped_model(name):
        return shipped
    if is_file(Path(name)):
        return Path(name)
    names = ', '.join(sorted(file.stem for file in _shipped().glob('*.safetensors'))) or 'none'
    raise ModelError(
        f'there is no model {name!r}; give the path of a model file, or the name of a shipped model: {names}'
    )


def shipped_model(name: str) -> Path | None:
    """The file of a shipped model."""
    file = _shipped() / f'{name}.safetensors'
    return file if is_file(file) else None


def _shipped() -> Path:
    return share_directory() / 'models'


def check_model_output(file: Path, *read: Path | None) -> None:
    """As `paths.check_output`. Raises ConfigurationError also for a name that says another format."""
    if file.suffix == '.onnx':
        raise ConfigurationError(f'cannot write {file}: write FILE.safetensors, and then: tactile model export FILE')
    check_output(file, *read)


def save_model(path: Path, model: ForceModel, card: Mapping[str, Any], rest_image: np.ndarray | None = None) -> str:
    """Write a model with its card and return its id; large tables are stored as 16 bit floats.

    `rest_image` (8 bit grey) shows the untouched gel; the drift monitor compares later images with it.

    The card must hold `flow` and `encoding` with their options, `crop_px`, and `gel` with its id. It is kept unchanged.

    Raises:
        ConfigurationError: no file can be written there.
        ModelError: writing failed, as on a full disk; an existing file stays unchanged.
    """
    tensors, readout = readout_arrays(model.readout)
    described = {**card, **_description(model, readout)}
    if rest_image is not None and rest_image.size:
        tensors[REST_IMAGE] = np.ascontiguousarray(rest_image, np.uint8)
    # One entry only: safetensors writes several in undefined order, and equal models should give equal files.
    metadata = {FORMAT: json.dumps({'sha256': NO_CHECKSUM, 'card': described}, sort_keys=True)}
    blank = safetensors.numpy.save(tensors, metadata)
    checksum = hashlib.sha256(blank).hexdigest()
    try:
        write_whole(path, blank.replace(NO_CHECKSUM.encode(), checksum.encode(), 1))
    except OSError as error:
        raise ModelError(f'cannot write the model file {path} ({error.strerror}); choose another folder') from error
    return checksum[:12]


def load_model(path: Path | str) -> LoadedModel:
    """Read a model and verify its checksum.

    Raises:
        ModelError: the file is missing, damaged, not a model of ours, or of a newer format.
    """
    path = Path(path)
    data = _read(path)
    entry = _entry(path, data)
    checksum = _verified(path, data, entry)
    card = entry['card']
    if card.get('format_version') not in range(FORMAT_VERSION, FIELD_VERSION + 1):
        raise ModelError(
            f'{path} has format version {card.get("format_version")}, but this release reads versions {FORMAT_VERSION} '
            f'to {FIELD_VERSION}; update tactile_nodes or train the model again'
        )
    return _loaded(path, data, card, checksum[:12])


def _description(model: ForceModel, readout: dict[str, Any]) -> dict[str, Any]:
    return {
        'format_version': _version(readout),
        'layout': asdict(model.layout),
        'bins': model.bins.card,
        'readout': readout,
        'parameters': model.readout.parameter_count,
        'contact_threshold_n': model.contact_threshold_n,
        'units': {'normal_force': 'N, positive into the gel', 'position': 'mm, surface frame', 'flow': 'px'},
    }


def _version(readout: Mapping[str, Any]) -> int:
    if readout['kind'] == FieldReadout.kind:
        return FIELD_VERSION
    if readout['kind'] == AxisymmetricReadout.kind:
        return SMEARED_VERSION
    return LAYERED_VERSION if 'calibration_layer' in readout else FORMAT_VERSION


def _read(path: Path) -> bytes:
    try:
        return read_plain(path, LARGEST_BYTES)
    except FileNotFoundError as error:
        raise ModelError(
            f'there is no model file {path}; check the path, or train one with: tactile train -o '
            f'{shlex.quote(str(path))}'
        ) from error
    except OSError as error:
        raise ModelError(f'cannot read the model file {path} ({error.strerror}); check it') from error


def _entry(path: Path, data: bytes) -> dict[str, Any]:
    """Our entry in a safetensors file, which begins with 8 bytes of length and a JSON header of that length."""
    length = int.from_bytes(data[:8], 'little')
    try:
        if not 2 <= length <= min(len(data) - 8, TEXT_BYTES):
            raise ValueError('the header is longer than the file, or than the limit')
        entry = json.loads(json.loads(data[8 : 8 + length])['__metadata__'][FORMAT])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelError(_foreign(path, data)) from error
    if not isinstance(entry, dict) or not isinstance(entry.get('card'), dict):
        raise ModelError(_damaged(path))
    return entry


def _verified(path: Path, data: bytes, entry: Mapping[str, Any]) -> str:
    checksum = str(entry.get('sha256'))
    blank = data.replace(checksum.encode(), NO_CHECKSUM.encode(), 1)
    if len(checksum) != len(NO_CHECKSUM) or hashlib.sha256(blank).hexdigest() != checksum:
        raise ModelError(_damaged(path))
    return checksum


def _loaded(path: Path, data: bytes, card: Mapping[str, Any], model_id: str) -> LoadedModel:
    try:
        bins = BinGrid.of_card(card['bins'])
        arrays = safetensors.numpy.load(data)
        _check_finite(arrays)
        model = ForceModel(
            layout=FeatureLayout(**card['layout']),
            bins=bins,
            readout=readout_from(arrays, card['readout'], bins),
            contact_threshold_n=card['contact_threshold_n'],
            model_id=model_id,
        )
        loaded = LoadedModel(model, card, arrays.get(REST_IMAGE, NO_IMAGE))
        _check_said(loaded)
        return loaded
    except ModelError:
        raise
    except (SafetensorError, LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise ModelError(
            f'{path} lacks a part of the model, or has an invalid one ({in_a_line(error)}); train or download it again'
        ) from error


def _check_said(loaded: LoadedModel) -> None:
    """Check the entries of the card now, so that reading them later does not fail."""
    _ = loaded.flow, loaded.encoding, loaded.image_size, loaded.gel
    for name, kind in (('crop_px', (int, Sequence)), ('gel', Mapping), ('contact_threshold_n', (int, float))):
        if not isinstance(loaded.card[name], kind):
            raise TypeError(f'{name} cannot be {loaded.card[name]!r:.40}')
    layout, mean = loaded.model.layout, loaded.model.readout.scaling.mean
    if mean.shape != (layout.rows, layout.cols, layout.channels):
        raise ValueError(f'its inputs are {mean.shape}, which does not fit its layout')


def _check_finite(arrays: Mapping[str, np.ndarray]) -> None:
    for name, array in arrays.items():
        if array.dtype.kind == 'f' and not np.isfinite(array).all():
            raise ValueError(f'{name} contains NaN or infinite numbers')


def _foreign(path: Path, data: bytes) -> str:
    if data[:2] == b'PK' or data[:1] == b'\x80':
        reason = 'is a pickle or PyTorch archive, which may run code when loaded, so it is not opened'
    else:
        reason = 'is not a model of tactile_nodes, or its beginning is damaged'
    return f'{path} {reason}; use a .safetensors file made by: tactile train'


def _damaged(path: Path) -> str:
    return f'{path} is damaged: its checksum does not match its content; download or train it again'
