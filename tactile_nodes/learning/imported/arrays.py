"""Presses of another project as arrays, read from HDF5, zarr or numpy files by their own libraries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.datasets.recordings import RecordedPresses
from tactile_nodes.learning.imported.importing import Imported, import_presses
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.recorded.building import BuildOptions
from tactile_nodes.learning.tables.pictures import ArrayPictures
from tactile_nodes.learning.tables.presses import PressTable, TablePress, require_possible
from tactile_nodes.model_file import find_model, load_model
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float

NAMES = {'x': 'x_mm', 'y': 'y_mm', 'force': 'force_n', 'depth': 'depth_mm'}
ORDERS = 'rgb', 'bgr'


def import_arrays(
    images: Any,
    x_mm: Float[np.ndarray, ' n'],
    y_mm: Float[np.ndarray, ' n'],
    force_n: Float[np.ndarray, ' n'],
    *,
    options: BuildOptions,
    indenter: str | Sequence[str] | None = None,
    shear_n: Float[np.ndarray, 'n 2'] | None = None,
    torque_nm: Float[np.ndarray, 'n 3'] | None = None,
    depth_mm: Float[np.ndarray, ' n'] | None = None,
    order: str = 'rgb',
    name: str = 'arrays',
    sensor: Sensor | None = None,
    progress: Progress | None = None,
    forced: bool = False,
) -> RecordedPresses:
    """The data set of presses given as arrays; `save_dataset` writes it.

    Places are in the surface frame: from the middle of the gel, x to the right and y down in the image. Forces act on
    the gel. Consecutive rows with equal values are images of one press.

    Args:
        images: (n, h, w) or (n, h, w, 3) of uint8, whole images of the camera. They are read row by row, so data sets
            of h5py or zarr can be used.
        x_mm: place along x.
        y_mm: place along y.
        force_n: force into the gel; 0 is the gel untouched, of which at least one image is needed.
        options: how images are measured; `options_of` reads them from a model.
        indenter: of all presses, or of each, if known.
        shear_n: force on the gel along x and y.
        torque_nm: about x, y and z (out of the gel).
        depth_mm: indentation depth, where known.
        order: of the colours: 'rgb' or 'bgr'.
        name: the arrays' name in errors.
        sensor: the description of the pressed sensor, which images must match.
        progress: shown while images are measured.
        forced: accept arrays whose places or forces contradict the images.

    Raises:
        DatasetError: arrays of another shape, a row that cannot be used, or that contradicts its image.
        ConfigurationError: an option that cannot be used.
    """
    count = len(images)
    columns: dict[str, Any] = {
        'x_mm': _numbers(f'{name}: x_mm', x_mm, count), 'y_mm': _numbers(f'{name}: y_mm', y_mm, count),
        'force_n': _numbers(f'{name}: force_n', force_n, count),
        'shear_n': _numbers(f'{name}: shear_n', shear_n, count, 2),
        'torque_nm': _numbers(f'{name}: torque_nm', torque_nm, count, 3),
        'depth_mm': _numbers(f'{name}: depth_mm', depth_mm, count),
        'indenter': [indenter or ''] * count if isinstance(indenter, str | bytes | None) else list(indenter),
    }  # fmt: skip
    if len(columns['indenter']) != count:
        raise DatasetError(f'{name}: indenter has {len(columns["indenter"])} rows, but there are {count} images')
    if order not in ORDERS:
        raise DatasetError(f'{name}: order is {order!r}, but must be one of {", ".join(map(repr, ORDERS))}')
    rows = tuple(_row(line, columns) for line in range(count))
    table = PressTable(Path(name), 'rows of arrays', rows, 'row')
    faults = table.faults
    for row in rows:
        with faults.row(row.line):
            require_possible(row, options.bins.reach_mm, NAMES)
    faults.require_none()
    source = Imported(table, ArrayPictures(images, order))
    return import_presses([source], options, Known(sensor), progress, command='import_arrays', forced=forced)


def options_of(model: str | Path, gel: str = '', frames: str = 'first') -> BuildOptions:
    """Options to measure as a model does, by its file or a shipped name; `frames` as for `tactile dataset import`.

    Raises:
        ModelError: there is no such model.
        ConfigurationError: `gel` is a file that is not a simulated gel.
    """
    return BuildOptions.of_model(load_model(find_model(str(model))), gel, frames)


def _numbers(name: str, values: Any, *shape: int) -> np.ndarray:
    """Numbers of this shape, with a row for each image; NaN where none are given."""
    if values is None:
        return np.full(shape, np.nan)
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise DatasetError(f'{name} must hold numbers, in the shape {shape}: a row for each image ({error})') from error
    if numbers.shape != shape:
        raise DatasetError(f'{name} has the shape {numbers.shape}, but must have {shape}: a row for each image')
    return numbers


def _row(line: int, columns: dict[str, Any]) -> TablePress:
    indenter = columns['indenter'][line] or ''
    fx, fy = columns['shear_n'][line].tolist()
    tx, ty, tz = columns['torque_nm'][line].tolist()
    x_mm, y_mm, force_n, depth_mm = (float(columns[name][line]) for name in ('x_mm', 'y_mm', 'force_n', 'depth_mm'))
    # A file may store its texts as bytes.
    text = indenter.decode('utf-8', 'replace') if isinstance(indenter, bytes) else str(indenter)
    return TablePress(
        line, f'row {line}', np.nan, x_mm, y_mm, force_n, (fx, fy), (tx, ty, tz), depth_mm, text
    )  # fmt: skip
