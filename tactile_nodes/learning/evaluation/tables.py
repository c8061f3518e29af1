"""Scores as tables, for a terminal or a page, and estimates as a CSV table.

Values that a model does not provide are shown as '-'.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.errors import DatasetError
from tactile_nodes.files import TEXT_BYTES
from tactile_nodes.learning.evaluation.predictions import Predictions
from tactile_nodes.learning.evaluation.scores import ALL, LIGHT_N, TOUCH_N, LightBand, LightScores, RestScores
from tactile_nodes.learning.evaluation.statuses import StatusScores
from tactile_nodes.learning.evaluation.text_table import Table
from tactile_nodes.learning.evaluation.uncertainty import Uncertainty
from tactile_nodes.messages import types
from tactile_nodes.paths import check_output

if TYPE_CHECKING:
    from tactile_nodes.learning.evaluation.evaluate import Evaluation

MERITS = {
    'presses': 'presses', 'armse_n': 'aRMSE N', 'd_loc_mm': 'd_loc mm', 'rmse_mc_n': 'RMSE_mc N',
    'right_bin': 'right bin', 'total_median_n': 'force N', 'total_p95_n': '95 % N', 'total_rmse_n': 'RMSE N',
    'position_median_mm': 'place mm', 'position_p95_mm': '95 % mm', 'missed': 'missed',
}  # fmt: skip
"""Column heads by the field of `PressScores`. Force and place are median and 95th percentile of the error."""
STATUSES = {
    'frames': 'frames', 'ok': 'ok', 'degraded': 'degraded', 'invalid': 'invalid', 'held': '90 % interval holds',
    'wrong_while_ok': 'wrong while ok',
}  # fmt: skip


def report(evaluations: Sequence[Evaluation]) -> str:
    """All scores of some models, starting with a comparison."""
    parts = [str(comparison(evaluations))] if len(evaluations) > 1 else []
    for each in evaluations:
        parts += ['\n'.join(filter(None, [f'model {each.name} ({each.model_id})', each.data])), *map(str, tables(each))]
    return '\n\n'.join(parts)


def tables(evaluation: Evaluation) -> list[Table]:
    """The tables of one model."""
    stated = [each for each in (evaluation.force_uncertainty, evaluation.position_uncertainty) if each]
    return [
        groups_table([evaluation]),
        rest_table([evaluation]),
        status_table(evaluation.statuses),
        *([light_table(evaluation.light)] if evaluation.light else []),
        *([coverage_table([evaluation])] if stated else []),
        *(curve_table(each) for each in stated),
    ]


def comparison(evaluations: Sequence[Evaluation]) -> Table:
    """Main scores for comparing models, one row per model: all presses, light touches, rest, coverage."""
    merit_heads = list(MERITS.values())[1:]
    heads = ('', *merit_heads, f'{1000 * TOUCH_N:g} mN seen', 'false contacts', '90 % force', '90 % place')
    rows = []
    for each in evaluations:
        merits = _cells(asdict(each.groups[ALL]), list(MERITS)[1:])
        light = each.light.detected if each.light else math.nan
        false = each.rest.false_contacts if each.rest else math.nan
        covered = (_covered(stated, ALL) for stated in (each.force_uncertainty, each.position_uncertainty))
        rows.append((each.name, *merits, percent(light), percent(false), *map(percent, covered)))
    return Table('side by side, all presses', heads, tuple(rows))


def groups_table(evaluations: Sequence[Evaluation]) -> Table:
    """Scores by group. For several models there is one row for each model and group."""
    several = len(evaluations) > 1
    rows = (
        ((f'{each.name}, {name}' if several else name), *_cells(asdict(scores), MERITS))
        for name in dict.fromkeys(name for each in evaluations for name in each.groups)
        for each in evaluations
        if (scores := each.groups.get(name)) is not None
    )
    return Table('', ('', *MERITS.values()), tuple(rows))


def rest_table(evaluations: Sequence[Evaluation]) -> Table:
    """Scores without contact."""
    heads = (
        'at rest', 'frames', 'mean N', 'RMS N', 'largest N', 'largest bin N', 'false contacts', '90 % interval holds',
    )  # fmt: skip
    return Table('', heads, tuple((each.name, *_rest_cells(each.rest)) for each in evaluations))


def _rest_cells(rest: RestScores | None) -> tuple[str, ...]:
    if rest is None:
        return ('0', *['-'] * 6)
    return tuple(_cells(asdict(rest), RestScores.__dataclass_fields__))


def light_table(light: LightScores) -> Table:
    """Touches up to 0.25 mm deep, by their true force."""
    title = (
        f'light touches: {percent(light.detected)} of {light.of_20_mn} from {1000 * TOUCH_N:g} mN on are detected '
        f'(contact counts from {1000 * light.threshold_n:.1f} mN)'
    )
    rows = [
        (
            _between(band),
            str(band.touches), percent(band.detected), number(band.total_rmse_n, 4), number(band.position_median_mm, 3),
        )
        for band in light.bands
    ]  # fmt: skip
    return Table(title, ('true force', 'touches', 'detected', 'RMSE N', 'place mm'), tuple(rows))


def _between(band: LightBand) -> str:
    low, high = (f'{1000 * force:g}' for force in (band.low_n, band.high_n))
    return f'{low} mN on' if band.high_n == LIGHT_N[-1] else f'{low} to {high} mN'


def coverage_table(evaluations: Sequence[Evaluation]) -> Table:
    """Share of true values inside the 90 % intervals, by depth."""
    heads = ['90 % interval holds'] + [
        f'{each.name}, {quantity}' for each in evaluations for quantity in ('force', 'place')
    ]
    stated = [part for each in evaluations for part in (each.force_uncertainty, each.position_uncertainty)]
    names = dict.fromkeys(name for part in stated if part for name in part.coverage)
    rows = [(name, *(percent(_covered(part, name)) for part in stated)) for name in names]
    if any(each.light for each in evaluations):
        light = [value for each in evaluations for value in _light_coverage(each.light)]
        rows.insert(1, ('light touches, detected for the place', *map(percent, light)))
    return Table('', tuple(heads), tuple(rows))


def curve_table(stated: Uncertainty) -> Table:
    """Stated against actual error, from the tenth with the smallest stated error to the largest."""
    places = 4 if stated.unit == 'N' else 3
    quantity = 'force' if stated.unit == 'N' else 'place, along an axis'
    shown = [[number(value, places) for value in (each.stated, each.actual)] for each in stated.curve]
    heads = (f'{quantity}: tenth of the presses', *(str(tenth + 1) for tenth in range(len(shown))))
    rows = tuple(
        (f'{row} error {stated.unit}', *(cells[place] for cells in shown))
        for place, row in enumerate(('stated', 'actual'))
    )
    return Table('', heads, rows)


def status_table(statuses: Mapping[str, StatusScores]) -> Table:
    """The statuses that the force topic would publish, and whether they are right."""
    rows = tuple((name, *_cells(asdict(scores), STATUSES)) for name, scores in statuses.items())
    return Table('', ('status', *STATUSES.values()), rows)


def _light_coverage(light: LightScores | None) -> tuple[float, float]:
    return (light.force_coverage, light.place_coverage) if light else (math.nan, math.nan)


def _covered(stated: Uncertainty | None, group: str) -> float:
    return stated.coverage.get(group, math.nan) if stated else math.nan


def _cells(scores: dict[str, object], fields: Iterable[str]) -> list[str]:
    return [cell(field, scores[field]) for field in fields]


def cell(field: str, value: object) -> str:
    """A number in the format of its field: N to a tenth of a mN, mm to a micrometre, counts, and shares in percent."""
    assert isinstance(value, (int, float))
    if isinstance(value, int):
        return str(value)
    if field.endswith('_n'):
        return number(value, 4)
    if field.endswith('_mm'):
        return number(value, 3)
    return percent(value)


def number(value: float, places: int) -> str:
    """Fixed point, '-' if unknown."""
    return '-' if math.isnan(value) else f'{value:.{places}f}'


def percent(value: float) -> str:
    """A share in percent, '-' if unknown."""
    return '-' if math.isnan(value) else f'{value:.1%}'


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
