"""The page of the ablation study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from benchmarks.ablation.mechanisms import BY_NAME
from benchmarks.harness.report import opening, table

PAYS = 1.1
"""A mechanism is useful if some figure without it is worse by more than a tenth."""

LEAST = {
    'force error, mN': 0.3, 'place, mm': 0.005, 'frames ok': 0.03, 'wrong while ok': 0.01, 'false contacts': 0.01,
    'CPU in contact, ms': 0.3, 'CPU at rest, ms': 0.3, 'CPU, 95 %, ms': 3.0, 'misplaced': 0.005, 'total, mN': 2.0,
    'centre, mm': 0.005, 'shear': 0.003, 'torsion': 0.003, '1 - map r': 0.005, 'worst while ok': 0.3,
    'aRMSE, any grid, mN': 0.1,
}  # fmt: skip
"""Smaller differences are chance, or have no effect in use."""

HIGHER_IS_BETTER = ('frames ok',)
SHOWN = 3

ABOUT = f"""\
Each mechanism of sensing and learning is switched off alone. Figures are measured with it and without it on the same
pictures: errors in the streams of [stability.md](stability.md) (16 presses each), of 80 contacts of ten families (with
a seed that no other page uses), and of `portable` calibrated for two other gels; and the CPU time of a frame (the whole
chain in NumPy, with and without in turn). A mechanism is *useful* if at least one figure gets worse by more than a
tenth without it. The table shows the {SHOWN} figures that get worst. *Wrong while ok* is the share of frames in contact
with status ok and an error of more than twice the nominal error. Mechanisms marked *removed* were removed after this
measurement. The rows come from several runs; the JSON file has the command and the commit of each."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    measured = {name: each for name, each in result.items() if isinstance(each, Mapping) and 'figures' in each}
    rows = [_row(name, measured[name]) for name in dict.fromkeys([*BY_NAME, *measured]) if name in measured]
    heads = ['mechanism', 'what it does', 'files', 'lines', 'without it', 'useful']
    first = next(iter(measured.values()), {})
    return '\n\n'.join([*opening('Ablation study', first, ABOUT), table(heads, rows)])


def _row(name: str, each: Mapping[str, Any]) -> list[str]:
    worse = sorted(worsened(each['figures']), reverse=True)
    shown = '; '.join(f'{where}: {figure} {_plain(a)} to {_plain(b)}' for _, where, figure, a, b in worse[:SHOWN])
    return [
        name, each['does'], str(len(each['files'])), str(each['lines']), shown or 'no figure gets worse by a tenth',
        _verdict(name, each, pays=bool(worse)),
    ]  # fmt: skip


def _verdict(name: str, each: Mapping[str, Any], *, pays: bool) -> str:
    if name not in BY_NAME:
        return 'removed'
    if pays:
        return 'yes'
    return f'no; kept: {each["stays"]}' if each.get('stays') else '**no**'


def worsened(figures: Mapping[str, Any]) -> Iterator[tuple[float, str, str, float, float]]:
    """Figures that are worse by more than a tenth without it: ratio, place, figure, values with and without it."""
    for where, measured in figures.items():
        for figure, both in measured.items():
            a, b = float(both['with']), float(both['without'])
            if (times := _times(figure, a, b)) > PAYS:
                yield times, where, figure, a, b


def _times(figure: str, a: float, b: float) -> float:
    """How many times `b` is worse than `a`; 0 for negligible differences, and if `a` is not finite."""
    if not math.isfinite(a):
        return 0.0
    if not math.isfinite(b):
        return math.inf
    good = figure in HIGHER_IS_BETTER
    if (a - b if good else b - a) < LEAST[figure]:
        return 0.0
    return a / max(b, 1e-3) if good else b / max(a, LEAST[figure])


def _plain(value: float) -> str:
    return f'{value:.3g}'
