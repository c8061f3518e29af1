"""A table of a model's estimates with the true values of each sample."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

from tactile_nodes.errors import DatasetError
from tactile_nodes.files import TEXT_BYTES
from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.messages import types
from tactile_nodes.paths import check_output

COLUMNS = (
    'sample', 'x_mm', 'y_mm', 'told_x_mm', 'told_y_mm', 'force_n', 'told_force_n', 'told_sigma_n', 'status',
)  # fmt: skip
STATUS = {
    types.ForceDistribution.STATUS_OK: 'ok',
    types.ForceDistribution.STATUS_DEGRADED: 'degraded',
    types.ForceDistribution.STATUS_INVALID: 'invalid',
}


def write_estimates(found: Predictions, file: Path) -> None:
    """Write a CSV file with one row per sample, counted from 1 in the order of the data set; never over another table.

    Lengths are in mm in the surface frame, total forces in N into the gel. An empty cell is unknown (the place of a
    sample at rest) or not reported (the place if no contact is found).

    Raises:
        ConfigurationError: no file can be written there.
        DatasetError: there is a table of other content, or writing failed, for example on a full disk.
    """
    check_output(file)
    try:
        if file.exists() and _first_line(file) not in {'', ','.join(COLUMNS)}:
            raise DatasetError(f'{file} is not a table of estimates and is not replaced; choose another name')
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open('w', encoding='utf-8', newline='') as opened:
            table = csv.writer(opened, lineterminator='\n')
            table.writerow(COLUMNS)
            table.writerows(_rows(found))
    except OSError as error:
        raise DatasetError(f'cannot write the table {file} ({error.strerror}); choose another place') from error


def _first_line(file: Path) -> str:
    with file.open('rb') as opened:
        return opened.readline(TEXT_BYTES).decode('utf-8', 'replace').strip()


def _rows(found: Predictions) -> Iterator[list[str]]:
    for sample, touched in enumerate(found.touched):
        place = found.place_mm[sample] if touched else (math.nan, math.nan)
        estimated_place = found.found_mm[sample] if found.detected[sample] else (math.nan, math.nan)
        numbers = *place, *estimated_place, found.force_n[sample], found.total_n[sample]
        cells = [_cell(number) for number in (*numbers, found.stated_sigma_n[sample])]
        yield [str(sample + 1), *cells, STATUS[int(found.status[sample])]]


def _cell(number: float) -> str:
    return f'{number:.4f}' if math.isfinite(number) else ''
