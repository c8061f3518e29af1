"""The page of the paper's transfer: tables, conclusions, and the figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.report import columns, opening, table
from benchmarks.transfer_paper.scores import (
    AS_IT_IS,
    GROUP,
    METRICS,
    NEW,
    OURS,
    OWN,
    REST,
    SCRATCH,
    WAYS,
    Score,
)
from benchmarks.transfer_paper.steps import EPOCHS, PRESSES

COLOURS = {'published layer': 'C3', 'a tenth of its rate': 'C1', 'layer as it ships': 'C0', SCRATCH: 'C7'}
READING = """\
The paper's layer (section V, Table III) has a rectified linear unit for each of the 3200 features, before the frozen
network. Its weights are initialized with the identity; batch size 64, learning rate 0.0001, dropout 0.05. The layer is
placed before the network's own scaling. There, magnitudes in px and angles in [0, 2 pi) are never negative, so the
untrained layer changes nothing.

There are 800 presses: every fourth place of the paper's grid along x and y, at its eight depths. In random order, the
first of them are for training, of which a tenth is for validation. The remaining presses are the paper's test (`rest`);
they are at the places of the training presses, at other depths. `new` are 300 presses at continuous places and depths
within 27x27 mm. Training stops after `--patience` epochs without a lower validation loss, in the paper after 200."""
TABLE = """\
Median over the gels, and the worst if there are several. The aRMSE depends on the number of presses, so every metric is
a mean over groups of about {group}. `own gel` is the source on the gel that it was trained on; there the coarse grid
contains places and depths of its training. `epoch` is the best epoch, `s` the time of a fit in seconds."""
WHY = """\
**Why the published learning rate does harm here.** Nadam divides the gradient by its own size, so its first step
changes every weight by about the learning rate, whatever the loss. All inputs of a unit are positive, and the gradients
of its weights have the sign of the unit's error. So the changes add up: the unit shifts by up to the rate times the sum
of its inputs (`at most`). The inputs of one press sum to thousands, most of it from angles (1600 of about pi).
Magnitudes, which determine the force, have a standard deviation of a few hundredths of a px to two tenths. The first
step alone shifts them by several standard deviations (`in sd`), which is outside the training of the frozen network.
Within an epoch the output is zero everywhere (`peaks`: predicted over true). Sparse labels reward this output, and the
logistic units have almost no gradient there.

The cause is neither dropout nor the batch: without either the result is the same. The cause is the step. At a tenth of
the rate the layer learns. At the published rate it also learns if the mean of the features is subtracted first. This is
the same layer with the same start (the bias compensates), but with smaller steps in the direction that all features
share. `layer as it ships` therefore subtracts the mean, has a learning rate of 0.00003, and keeps the identity unless
an epoch is better.

The paper does not give the units of its features, the scaling of its network, or which epoch was kept. With angles in
turns the same rate would shift magnitudes about four times less. So this says nothing about the paper's own numbers.
For magnitudes in px and angles in rad its learning rate is too large."""


def page(result: Mapping[str, Any]) -> str:
    """The results as a page of documentation."""
    scores = _scores(result)
    gels = len({each.gel for each in scores if each.gel != OWN})
    more = f'simulated gels: those of [transfer](transfer.md), {gels} of them'
    return '\n\n'.join([
        *opening("The paper's calibration layer on other gels", result, READING, more), TABLE.format(group=GROUP),
        _table(scores), _found(scores), '![the three metrics against the number of presses](transfer_paper.png)',
        '## First steps',
        f'aRMSE after some training on one gel with {PRESSES} presses, tested on the other presses of the grid.',
        _steps(result['steps']), WHY,
    ])  # fmt: skip


def _scores(result: Mapping[str, Any]) -> list[Score]:
    return [Score(**each) for each in result['scores']]


def _found(scores: Sequence[Score]) -> str:
    """Errors of the shipped layer with the most presses, on both tests, beside those without calibration."""
    most = max(each.presses for each in scores)
    errors = []
    for tested in (REST, NEW):
        mine = [each for each in scores if each.tested == tested and each.gel != OWN]
        pair = (_median(mine, 'armse_n', *each) for each in ((AS_IT_IS, 0), (OURS, most)))
        errors.append('aRMSE {:.4f} N without, {:.4f} N with it'.format(*pair))
    return (
        f'With {most} presses `{OURS}` on the {REST}: {errors[0]};\nat {NEW}: {errors[1]}. '
        'The difference\nbetween the tests shows that the layer learns the places, and generalizes little between them.'
    )


def _table(scores: Sequence[Score]) -> str:
    heads = ['', 'presses', *(f'{name}: {text}' for name in ('rest', 'new') for text in METRICS.values()), 'epoch', 's']
    own = [each for each in scores if each.gel == OWN]
    rows = [['own gel', '', *_cells(own), '', '']]
    others = [each for each in scores if each.gel != OWN]
    for way, count in sorted(
        {(each.way, each.presses) for each in others}, key=lambda pair: (WAYS.index(pair[0]), pair)
    ):
        chosen = [each for each in others if (each.way, each.presses) == (way, count)]
        fitted = [each for each in chosen if each.tested == NEW and each.epochs]
        cost = _cost(fitted) if fitted else ['', '']
        rows.append([way, str(count or '-'), *_cells(chosen), *cost])
    return table(heads, rows)


def _cost(fitted: Sequence[Score]) -> list[str]:
    return [f'{np.median([getattr(each, name) for each in fitted]):.0f}' for name in ('best_epoch', 'seconds')]


def _cells(scores: Sequence[Score]) -> list[str]:
    cells = []
    for tested in (REST, NEW):
        for metric in METRICS:
            values = [getattr(each, metric) for each in scores if each.tested == tested]
            digits = 3 if metric == 'd_loc_mm' else 4
            worst = f' ({max(values):.{digits}f})' if len(values) > 1 else ''
            cells.append(f'{np.median(values):.{digits}f}{worst}')
    return cells


def _steps(steps: Sequence[Mapping[str, Any]]) -> str:
    return columns(
        steps,
        ('', '{setting}'), ('rate', '{rate:g}'), ('at most, px', '{most_px:.3f}'), ('moved, px', '{moved_px:.3f}'),
        ('in sd', '{moved_spreads:.2f}'), ('before, N', '{start_n:.4f}'), ('1 step', '{step_n:.4f}'),
        ('1 epoch', '{epoch_n:.4f}'), (f'{EPOCHS} epochs', '{last_n:.4f}'), ('peaks', '{peak_share:.2f}'),
    )  # fmt: skip


def draw(result: Mapping[str, Any], folder: Path, name: str) -> None:
    """Plot the three metrics against the number of presses: dashed on the rest of the 800, solid at new places.

    Raises:
        ConfigurationError: matplotlib is not installed.
        DatasetError: the file cannot be written.
    """
    from tactile_nodes.learning.figures import figure, save

    scores = _scores(result)
    counts = sorted({each.presses for each in scores if each.presses})
    drawn = figure(11.0, 4.2)  # raises if matplotlib is missing
    from matplotlib.ticker import FuncFormatter, LogLocator

    for place, (metric, text) in enumerate(METRICS.items()):
        axes = drawn.add_subplot(1, 3, place + 1)
        _draw_metric(axes, scores, metric)
        axes.set(xscale='log', yscale='log', xlabel='presses on the new gel', ylabel=text)
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
    handles, labels = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc='outside upper center', ncols=4, fontsize='small')
    save(drawn, folder / f'{name}.png')


def _draw_metric(axes: Any, scores: Sequence[Score], metric: str) -> None:
    for tested, line in ((REST, '--'), (NEW, '-')):
        mine = [each for each in scores if each.tested == tested]
        for way, colour in COLOURS.items():
            counts = sorted({each.presses for each in mine if each.way == way})
            medians = [_median(mine, metric, way, count) for count in counts]
            axes.plot(counts, medians, line, marker='o', color=colour, label=f'{way}, {tested}')
        for name, colour, own in ((AS_IT_IS, 'black', False), ('own gel', 'C2', True)):
            level = np.median([
                getattr(each, metric) for each in mine if each.way == AS_IT_IS and (each.gel == OWN) == own
            ])  # fmt: skip
            axes.axhline(level, linestyle=line, color=colour, linewidth=1, label=f'{name}, {tested}')


def _median(scores: Sequence[Score], metric: str, way: str, count: int) -> float:
    return float(np.median([getattr(each, metric) for each in scores if (each.way, each.presses) == (way, count)]))
