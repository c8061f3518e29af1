"""The page about the models' accuracy: tables from the numbers of `tactile bench accuracy`, and pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.accuracy.times import STAGES
from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, ranged, table
from tactile_nodes.learning.evaluation import tables
from tactile_nodes.learning.evaluation.evaluate import Evaluation
from tactile_nodes.learning.evaluation.picture import EVALUATION_DPI, subplots
from tactile_nodes.learning.evaluation.scores import ALL, PressScores
from tactile_nodes.learning.evaluation.tables import number, percent
from tactile_nodes.learning.evaluation.text_table import Table
from tactile_nodes.learning.figures import save

PAPER = {'armse_n': 0.009, 'd_loc_mm': 0.107, 'rmse_mc_n': 0.065}
"""Table II of the paper, measured on a real gel."""
PAPER_PARAMETERS = 3200 * 800 + 800 + 800 * 400 + 400 + 400 * 400 + 400 + 400 * 81 + 81
"""Weights and biases of its network."""
INTRODUCTION = """\
All results are simulated, with the gel that the models were trained on. The paper's figures were measured on a real
gel. Off the grid: presses at random places within 27x27 mm and random depths of 0.25 to 2 mm. Their seed, rest images
and noise differ from those of the training. `force` is the median absolute error of the total force, `place` the median
distance to the true place, `95 %` the 95th percentile of either, and `missed` the share of presses for which the model
reports no contact."""
UNCERTAINTY = """\
Coverage: the share of true values within the stated 90 % intervals (for places: along each axis). The target is 87 to
93 %."""


@dataclass(frozen=True)
class Results:
    """Measurements of some models; the evaluations are in the order of the models.

    `aside` is on the presses that the training of the `paper` plan's model set aside; empty if no model has such.
    """

    plain: dict[str, Any]
    off_grid: Sequence[Evaluation]
    aside: Sequence[Evaluation]
    curve: Sequence[Evaluation]


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    results: Results = result['_page']
    plan = result['plan']
    more = f'{plan["presses"]} presses off the grid, {plan["rounds"]} rounds of {plan["images"]} images for the times'
    parts = [
        *opening('How accurate the models are', result, INTRODUCTION, more),
        '## Compared with the paper', _beside_the_paper(results), '## Targets', reached(AIMS, result),
        '## Models', _models(result['models']),
        '## Off the grid', _shown(tables.groups_table(results.off_grid)),
        '## Light touches and rest', *_light(results.off_grid),
        '## Uncertainty', *_uncertainty(results.off_grid),
        '## Times', _times(result['times_ms']),
        *_aside(results.aside), *_curve(results), *_pictures(results),
    ]  # fmt: skip
    return '\n\n'.join(part for part in parts if part)


def draw(result: Mapping[str, Any], folder: Path, _: str) -> None:
    """Draw the errors of each model, and those against the number of presses."""
    from tactile_nodes.learning.evaluation.picture import draw as draw_errors

    results: Results = result['_page']
    for each in results.off_grid:
        draw_errors(each.answers, f'{each.name} ({each.model_id})', folder / picture_name(each.name))
    if results.curve:
        curve_picture(results, folder / picture_name('presses'))


def picture_name(model: str) -> str:
    """The file name of a model's chart, beside the page."""
    return f'accuracy_{model}.png'


def curve_picture(results: Results, file: Path) -> None:
    """Plot errors of place and force against the number of presses, with a line for each plan.

    Raises:
        ConfigurationError: matplotlib is not installed, or the file cannot be written.
    """
    figure, axes = subplots(1, 2)
    for axis, field, name in (
        (axes[0, 0], 'position_median_mm', 'place, median [mm]'), (axes[0, 1], 'total_rmse_n', 'force, RMSE [N]')
    ):  # fmt: skip
        for plan, points in _by_plan(results).items():
            values = [getattr(scores, field) for _, scores in points]
            axis.loglog([presses for presses, _ in points], values, 'o-', label=plan)
        axis.set(xlabel='presses', ylabel=name)
        axis.grid(which='both', linewidth=0.3)
        axis.legend()
    figure.suptitle('error off the grid against the number of presses to learn from')
    save(figure, file, EVALUATION_DPI)


def _shown(table: Table) -> str:
    return '\n\n'.join(filter(None, [table.title, table.markdown()]))


def _models(models: dict[str, Any]) -> str:
    heads = ('model', 'id', 'readout', 'flow', 'features', 'trained on', 'with')
    rows = [
        (name, about['model_id'], about['readout'], about['flow'], about['features'], about['device'] or '-',
         f'`{about["command"]}`' if about['command'] else '-')
        for name, about in models.items()
    ]  # fmt: skip
    return table(heads, rows)


def _beside_the_paper(results: Results) -> str:
    heads = (
        '', 'on grid: aRMSE N', 'd_loc mm', 'RMSE_mc N', 'off grid: aRMSE N', 'd_loc mm', 'RMSE_mc N', 'place mm',
        'RMSE N', 'parameters', 'training s', 'presses',
    )  # fmt: skip
    rows = [('the paper, real gel', *_merits(PAPER), *['-'] * 5, str(PAPER_PARAMETERS), '-', '10952, paper')]
    aside = {each.name: each.groups[ALL] for each in results.aside}
    for each in results.off_grid:
        about, off = results.plain['models'][each.name], each.groups[ALL]
        seconds = '-' if about['training_s'] is None else f'{about["training_s"]:.0f}'
        rows.append((
            each.name, *(_merits(vars(aside[each.name])) if aside else ['-'] * 3), *_merits(vars(off)),
            number(off.position_median_mm, 3), number(off.total_rmse_n, 4), str(about['parameters']), seconds,
            f'{about["presses"]}, {about["plan"]}',
        ))  # fmt: skip
    if not aside:
        return table(heads, rows)
    return f'On the grid: {results.aside[0].data}.\n\n{table(heads, rows)}'


def _merits(scores: dict[str, Any]) -> list[str]:
    return [number(scores['armse_n'], 4), number(scores['d_loc_mm'], 3), number(scores['rmse_mc_n'], 4)]


def _of_each(tell: Callable[[Evaluation], str]) -> Callable[[Mapping[str, Any]], dict[str, str]]:
    """The value of an aim for each model, off the grid."""
    return lambda result: {each.name: tell(each) for each in result['_page'].off_grid}


def _of_paper(field: str) -> Callable[[Mapping[str, Any]], dict[str, str]]:
    """The value of an aim relative to the model `paper`, on the grid if that was evaluated."""

    def shares(result: Mapping[str, Any]) -> dict[str, str]:
        judged = result['_page'].aside or result['_page'].off_grid
        values = {each.name: {**result['models'][each.name], **vars(_all(each))}[field] for each in judged}
        return {name: _share(value, values['paper']) for name, value in values.items()} if 'paper' in values else {}

    return shares


AIMS = (
    Aim('place, median', 'at most 0.10 mm', _of_each(lambda each: number(_all(each).position_median_mm, 3))),
    Aim('total force, RMSE', 'at most 0.010 N', _of_each(lambda each: number(_all(each).total_rmse_n, 4))),
    Aim(
        'touches of at least 20 mN detected', 'all',
        _of_each(lambda each: percent(each.light.detected if each.light else math.nan)),
    ),
    Aim('aRMSE, relative to `paper`', 'at most 1/3', _of_paper('armse_n')),
    Aim('RMSE_mc, relative to `paper`', 'at most 1/4', _of_paper('rmse_mc_n')),
    Aim('d_loc, relative to `paper`', 'at most 1/4', _of_paper('d_loc_mm')),
    Aim('training time, relative to `paper`', 'at most 1/20', _of_paper('training_s')),
    Aim('parameters, relative to `paper`', 'at most 1/10', _of_paper('parameters')),
)  # fmt: skip


def _share(value: float | None, whole: float | None) -> str:
    return f'{value / whole:.3f}' if value is not None and whole else '-'


def _all(evaluation: Evaluation) -> PressScores:
    return evaluation.groups[ALL]


def _light(evaluations: Sequence[Evaluation]) -> list[str]:
    light = [f'**{each.name}**: {_shown(tables.light_table(each.light))}' for each in evaluations if each.light]
    return [*light, _shown(tables.rest_table(evaluations))]


def _uncertainty(evaluations: Sequence[Evaluation]) -> list[str]:
    parts = [UNCERTAINTY, _shown(tables.coverage_table(evaluations))]
    for each in evaluations:
        for stated in (each.force_uncertainty, each.position_uncertainty):
            if stated:
                parts += [f'**{each.name}**', _shown(tables.curve_table(stated))]
    return parts


def _times(times: dict[str, Any]) -> str:
    heads = ('ms per frame', *STAGES, 'sum', 'predict, ratio', 'sum, ratio')
    rows = [
        (name, *(number(taken[stage]['median'], 2) for stage in (*STAGES, 'sum')),
         *(ranged(taken[ratio]) for ratio in ('predict_ratio', 'sum_ratio')))
        for name, taken in times.items()
    ]  # fmt: skip
    return table(heads, rows)


def _aside(evaluations: Sequence[Evaluation]) -> list[str]:
    return ['## On the grid', _shown(tables.groups_table(evaluations))] if evaluations else []


def _curve(results: Results) -> list[str]:
    if not results.curve:
        return []
    heads = ('plan', 'presses', 'place mm', '95 % mm', 'RMSE N', '95 % N', 'aRMSE N', 'RMSE_mc N')
    rows = [
        (plan, str(presses), number(scores.position_median_mm, 3), number(scores.position_p95_mm, 3),
         number(scores.total_rmse_n, 4), number(scores.total_p95_n, 4), number(scores.armse_n, 4),
         number(scores.rmse_mc_n, 4))
        for plan, points in _by_plan(results).items()
        for presses, scores in points
    ]  # fmt: skip
    return [
        '## Accuracy against presses', table(heads, rows), f'![error against presses]({picture_name("presses")})'
    ]  # fmt: skip


def _by_plan(results: Results) -> dict[str, list[tuple[int, PressScores]]]:
    """Numbers of presses and scores of the models for the curve, by readout and plan."""
    plans: dict[str, list[tuple[int, PressScores]]] = {}
    for about, each in zip(results.plain['curve'], results.curve, strict=True):
        plans.setdefault(f'{about["readout"]}, {about["plan"]}', []).append((about['presses'], _all(each)))
    return {name: sorted(points, key=lambda point: point[0]) for name, points in sorted(plans.items())}


def _pictures(results: Results) -> list[str]:
    shown = [f'![errors of {each.name}]({picture_name(each.name)})' for each in results.off_grid]
    return ['## Pictures', *shown]
