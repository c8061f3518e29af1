"""The page of transfer: errors against presses as a table and a figure, and the tested gels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, table
from benchmarks.transfer.scores import (
    ALONE,
    AS_IT_IS,
    CALIBRATED,
    COMPARED,
    COUNTS,
    MANY,
    MEASURES,
    OWN_GEL,
    PICTURES,
    PLACEMENTS,
    TRAINED,
    Ratio,
    Score,
    ratio,
)

if TYPE_CHECKING:
    from tactile_nodes.simulation.gel import Gel

HEADS = [
    '',
    'presses',
    'force RMSE, N',
    'place, mm',
    'aRMSE, N',
    'aRMSE, any grid, N',
    'd_loc, mm',
    'RMSE_mc, N',
    'covered',
    'time, s',
    'form',
]
COLOURS = {CALIBRATED: 'C0', ALONE: 'C7', AS_IT_IS: 'C3', MANY: 'C1', TRAINED: 'C2'}
DRAWN = {'force_rmse_n': 'force RMSE, N', 'place_median_mm': 'place, mm', 'placed_armse_n': 'aRMSE, any grid, N'}
OF_FORCE = 'force', 'aRMSE'
GEL_HEADS = ['gel', 'modulus, kPa', 'soft layer, mm', 'camera shift, mm', 'tilt, deg', 'roll, deg', 'focal, px/rad']
ABOUT = """\
Median (worst) over {gels} simulated gels. Each is tested on {tested} presses at new, continuous places; the source
model's own gel (first row) at the same places and depths. `place` is the median over the presses of a gel, and
`covered` the share of forces within the stated 90 % interval. `of many gels` is one response fitted to other gels with
the same variation, without a press on the tested gel. Calibrations use the first presses of
`config/plans/calibrate.yaml`, {pictures}. `fitted alone` uses the first of these pictures.
Each tested press has one picture.

The aRMSE is dominated by presses that are closer to a border between bins than the error of their place. On the paper's
grid these are few. `any grid` is the mean over {placements} positions of that grid, so that all presses count.
It grows with the number of tested presses, as fewer bins are left without such a press."""
CHANCE = """\
Ratios of errors, with standard errors over the tested presses (bootstrap, same draws for all gels). The aRMSE is that
on any grid. The standard errors do not include the variation between calibration presses or between gels."""
HARDER = """\
All gels were pressed to the same depths. A gel that is a third harder carried a third more force, so the same error of
motion means a third more newtons. The same ratios, with errors divided by the mean force of each gel:"""
LEVELS = """\
A gel that is harder, thicker or seen at an angle may have larger errors even with perfect calibration. The first row
shows this effect of the gels. The second row shows the effect of training with fewer presses than the source had. The
other rows show what calibration adds."""
BORNE = """\
Ratios to the source model on its own gel, for errors in newtons (in brackets: for errors divided by the mean force).
`force ratio` is the mean force of the gel divided by that of the source gel at the same depths. A gel that is read as
well as the source's own gel has this number in newtons, and 1 in brackets."""
AIMS = {100: 1.1, 25: 1.5}
"""Largest error relative to the source's own error, by number of presses."""


@dataclass(frozen=True)
class Measured:
    """The content of the page, with the statistical errors that are not in the JSON file."""

    own: Score
    scores: Sequence[Score]
    gels: Sequence[Gel] = ()
    picture: str = 'transfer.png'
    pictures: int = PICTURES


def page(result: Mapping[str, Any]) -> str:
    """The results as a page of documentation."""
    measured: Measured = result['_page']
    own, scores = measured.own, [each for each in measured.scores if each.gel != OWN_GEL]
    trained = [each for each in measured.scores if each.gel == OWN_GEL]
    about = ABOUT.format(
        gels=len({each.gel for each in scores}), tested=own.tested, pictures=_held(measured.pictures),
        placements=PLACEMENTS,
    )  # fmt: skip
    return '\n\n'.join([
        *opening('Transfer to other gels', result, about), *_of_trained(trained),
        f'![error against number of presses]({measured.picture})', _errors(own, scores, trained),
        '## Compared with the source on its own gel', CHANCE, reached(_aims(own, scores), result),
        HARDER, table(['presses', *(f'{of}, median gel (worst)' for of in OF_FORCE)], _of_force(own, scores)),
        *_against_each(own, scores, trained), *_gel_by_gel(own, scores), '## The gels',
        table(GEL_HEADS, [_gel(number, each) for number, each in enumerate(measured.gels)]),
    ])  # fmt: skip


def _errors(own: Score, scores: Sequence[Score], trained: Sequence[Score]) -> str:
    rows = [_row(way, presses, scores) for presses in (0, *COUNTS) for way in (AS_IT_IS, MANY, CALIBRATED, ALONE)]
    rows += [_row(TRAINED, presses, scores) for presses in sorted({s.presses for s in scores if s.way == TRAINED})]
    levels = [_own('all', own), *(_own(str(each.presses), each) for each in trained)]
    return table(HEADS, [*levels, *(each for each in rows if each)])


def _row(way: str, presses: int, scores: Sequence[Score]) -> list[str]:
    chosen = [each for each in scores if (each.way, each.presses) == (way, presses)]
    if not chosen:
        return []
    values = [[getattr(each, name) for each in chosen] for name in MEASURES]
    forms = [each.form for each in chosen if each.form]
    counted = ', '.join(f'{forms.count(form)} {form}' for form in dict.fromkeys(forms))
    seconds = f'{np.median([each.seconds for each in chosen]):.1f}' if forms else ''
    covered = f'{np.median([each.covered for each in chosen]):.2f} ({min(each.covered for each in chosen):.2f})'
    summed = [f'{np.median(each):.4f} ({max(each):.4f})' for each in values]
    return [way, str(presses), *summed, covered, seconds, counted]


def _own(presses: str, own: Score) -> list[str]:
    """The row of a model on the source's own gel."""
    return ['own gel', presses, *(f'{getattr(own, name):.4f}' for name in MEASURES), f'{own.covered:.2f}', '', '']


def _held(pictures: int) -> str:
    return 'one picture each' if pictures == 1 else f'held for {pictures} pictures each'


def _of_trained(trained: Sequence[Score]) -> list[str]:
    return [
        f'`{TRAINED}` is a model of the same kind, trained in full on the tested gel with {each.presses} presses at\n'
        'random places and depths, different from those tested. The second row is the same on the source gel.'
        for each in trained
    ]


def _against_each(own: Score, scores: Sequence[Score], trained: Sequence[Score]) -> list[str]:
    """Separate the errors due to the gels from those due to calibration, if models were trained on each gel."""
    levels = [each for each in scores if each.way == TRAINED]
    if not levels:
        return []
    rows = [[f'{TRAINED} / source', *(_ratio_text(ratio(own, levels, measured)) for measured in COMPARED)]]
    rows += [
        [
            f'own gel, {each.presses} presses / source',
            *(_ratio_text(ratio(own, [each], measured)) for measured in COMPARED),
        ]
        for each in trained
    ]
    for presses, chosen in _calibrated(scores).items():
        of = [next(level for level in levels if level.gel == each.gel) for each in chosen]
        ratios = [_ratio_text(ratio(of, chosen, measured)) for measured in COMPARED]
        rows.append([f'calibrated, {presses} presses / {TRAINED}', *ratios])
    heads = ['', *(f'{of}, median gel (worst)' for of in COMPARED)]
    return ['## Compared with a model trained on each gel', LEVELS, table(heads, rows)]


def _aims(own: Score, scores: Sequence[Score]) -> list[Aim]:
    """The aims: error relative to the source's own error, by number of presses."""
    return [
        Aim(f'{presses} presses', f'{AIMS[presses]:.1f}x' if presses in AIMS else '', partial(_reached, own, chosen))
        for presses, chosen in _calibrated(scores).items()
    ]


def _reached(own: Score, chosen: Sequence[Score], _: Mapping[str, Any]) -> dict[str, str]:
    return {f'{of}, median gel (worst)': _ratio_text(ratio(own, chosen, of)) for of in COMPARED}


def _of_force(own: Score, scores: Sequence[Score]) -> list[list[str]]:
    return [
        [str(presses), *(_ratio_text(ratio(own, chosen, measured, of_force=True)) for measured in OF_FORCE)]
        for presses, chosen in _calibrated(scores).items()
    ]


def _calibrated(scores: Sequence[Score]) -> dict[int, list[Score]]:
    """The scores of calibrations by number of presses; numbers without scores are left out."""
    of = {n: [each for each in scores if (each.way, each.presses) == (CALIBRATED, n)] for n in COUNTS}
    return {presses: chosen for presses, chosen in of.items() if chosen}


def _gel_by_gel(own: Score, scores: Sequence[Score]) -> list[str]:
    """Ratios gel by gel, which show the part due to the gel's force at a depth."""
    asked = {f'{presses} presses': (CALIBRATED, presses) for presses in sorted(AIMS)}
    asked |= {each.way: (TRAINED, each.presses) for each in scores if each.way == TRAINED}
    asked = {name: way for name, way in asked.items() if way in {(each.way, each.presses) for each in scores}}
    if not asked:
        return []
    rows = []
    for gel in sorted({each.gel for each in scores}):
        of = {(each.way, each.presses): each for each in scores if each.gel == gel}
        borne = next(iter(of.values())).pressed_n / own.pressed_n
        times = [ratio(own, [of[way]], measured).worst for measured in OF_FORCE for way in asked.values()]
        rows.append([str(gel), f'{borne:.2f}x', *(f'{each:.2f}x ({each / borne:.2f}x)' for each in times)])
    heads = ['gel', 'force ratio', *(f'{of}, {name}' for of in OF_FORCE for name in asked)]
    return ['## Gel by gel', BORNE, table(heads, rows)]


def _ratio_text(of: Ratio) -> str:
    return f'{of.median:.2f}x ±{of.median_error:.2f} ({of.worst:.2f}x ±{of.worst_error:.2f})'


def _gel(number: int, gel: Gel) -> list[str]:
    aside, tilt = (', '.join(f'{each:+.2f}' for each in pair) for pair in (gel.camera_shift_mm, gel.camera_tilt_deg))
    numbers = f'{gel.camera_roll_deg:+.2f}', f'{gel.focal_px_per_rad:.1f}'
    return [str(number), f'{1e3 * gel.shear_modulus_mpa:.1f}', f'{gel.soft_mm:.1f}', aside, tilt, *numbers]


def draw(result: Mapping[str, Any], folder: Path, name: str) -> None:
    """Plot the error against the number of presses: median over the gels as lines, all gels as a band.

    Raises:
        ConfigurationError, DatasetError: see `tactile_nodes.learning.figures`.
    """
    from tactile_nodes.learning.figures import figure, save

    own, scores = result['_page'].own, result['_page'].scores
    drawn = figure(12, 4)
    for panel, (measured, label) in zip(drawn.subplots(1, 3), DRAWN.items(), strict=True):
        for way in (CALIBRATED, ALONE):
            _line(panel, way, measured, scores)
        for way in (AS_IT_IS, MANY):
            values = [getattr(each, measured) for each in scores if each.way == way]
            if values:
                panel.axhline(np.median(values), color=COLOURS[way], linestyle='--', label=f'{way}, no press')
        panel.axhline(getattr(own, measured), color='k', linestyle=':', label='source on its own gel')
        _band(panel, measured, [each for each in scores if each.way == TRAINED and each.gel != OWN_GEL])
        panel.set(xscale='log', yscale='log', xlabel='presses on the new gel', ylabel=label)
        panel.set_xticks(COUNTS, [str(count) for count in COUNTS])
        panel.minorticks_off()
        panel.grid(alpha=0.3, which='both')
    drawn.axes[0].legend(fontsize=8)
    save(drawn, folder / f'{name}.png')


def _band(panel: Any, name: str, trained: Sequence[Score]) -> None:
    """Draw the level of models trained on each gel: the median as a line, all of them as a band."""
    if not trained:
        return
    values = [getattr(each, name) for each in trained]
    panel.axhline(np.median(values), color=COLOURS[TRAINED], linestyle='-.', label=TRAINED)
    panel.axhspan(min(values), max(values), color=COLOURS[TRAINED], alpha=0.15)


def _line(panel: Any, way: str, name: str, scores: Sequence[Score]) -> None:
    groups = [[getattr(each, name) for each in scores if (each.way, each.presses) == (way, n)] for n in COUNTS]
    known = [(n, group) for n, group in zip(COUNTS, groups, strict=True) if group]
    if not known:
        return
    counts, values = [n for n, _ in known], [group for _, group in known]
    panel.plot(counts, [np.median(each) for each in values], 'o-', color=COLOURS[way], label=way)
    panel.fill_between(
        counts, [min(each) for each in values], [max(each) for each in values], color=COLOURS[way], alpha=0.2
    )
