"""The page of the bench of contacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, table

PRESSES = 100, 10, 0
BEST = f'field, {PRESSES[0]} presses'
ABOUT = """\
{frames} contacts of ten families (seed {seed}), most of them dragged, some twisted, solved at finite strain with
friction; up to 3 N, the tip up to 1 N. *Misplaced* is half the sum over the bins of |told - true|, over the true
total. *Total* is the normal force: root mean square, and median of |told - true| over the true one. *Centre* is the
median distance of the centres of pressure, *shear* the median error of the net shear where that exceeds 50 mN,
*torsion* that of a single contact where it exceeds 1 N mm. *Map r* is the correlation with the true pressure on 27x27
cells. *Held* is the share of 90 % intervals that hold the truth (a bin counts where it has 1 % of the force, told or
true). *Worst while ok* is the largest error of a total over the model's nominal one. CPU is the whole chain on one
thread, from image to message, as a share of OpenCV's DIS (medium) in the same run ({dis_ms:.1f} ms): median and 95th
percentile; *chain* is that median over what flow and readout take alone. Inner loops are numpy's, but for what is
called compiled: by numba, where that is installed, read by itself after the others."""

BROAD = """\
Under the middle of a contact that is wide beside the layer's 6 mm next to nothing moves. To be reached: told within
20 %, with intervals that hold, and never nothing."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    models = result['models']
    about = ABOUT.format(frames=next(iter(models.values()))['frames'], seed=result['seed'], dis_ms=result['dis_ms'])
    parts = [
        *opening('Any contact', result, about),
        '![speed against accuracy](speed_accuracy.png)',
        _models(result), '## What was to be reached', reached(AIMS, result),
        '## Family by family, `field` with 100 presses', _families(models[BEST]['families']),
    ]  # fmt: skip
    parts += ['## Broad contacts', BROAD, _broad(result['broad'])]
    if result['disturbed']:
        parts += ['## In disturbed pictures, `field` with 100 presses', _disturbed(result['disturbed'])]
    return '\n\n'.join(parts)


def _models(result: Mapping[str, Any]) -> str:
    heads = [
        'model', 'misplaced', 'aRMSE [N]', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'torsion', 'map r',
        'total held', 'shear held', 'bins held', 'ok', 'worst while ok', 'by field', 'CPU / DIS', '95 %', 'chain',
    ]  # fmt: skip
    return table(heads, [[name, *_row(each, result['dis_ms'])] for name, each in result['models'].items()])


def _row(each: Mapping[str, float], dis_ms: float) -> list[str]:
    return [
        share(each['misplaced']), f'{each["armse_n"]:.4f}', f'{each["total_rms_n"]:.3f}', share(each['total_median']),
        f'{each["centre_mm_median"]:.3f}', share(each['shear_median']), share(each['torsion_median']),
        f'{each["map_r"]:.2f}', share(each['total_held']), share(each['shear_held']), share(each['bins_held']),
        share(each['ok']), f'{each["worst_while_ok"]:.1f}', share(each['field']), f'{each["cpu_ms"] / dis_ms:.2f}',
        f'{each["cpu_95_ms"] / dis_ms:.2f}', _surrounded(each),
    ]  # fmt: skip


def _surrounded(each: Mapping[str, float]) -> str:
    """How much the whole chain takes, over flow and readout alone, where that was measured."""
    return f'{each["cpu_ms"] / each["least_cpu_ms"]:.2f}' if 'least_cpu_ms' in each else '–'


def _families(families: Mapping[str, Mapping[str, float]]) -> str:
    heads = ['family', 'misplaced', 'aRMSE [N]', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'ok', 'by field']
    rows = [
        [
            name, share(each['misplaced']), f'{each["armse_n"]:.4f}', f'{each["total_rms_n"]:.3f}',
            share(each['total_median']), f'{each["centre_mm_median"]:.3f}', share(each['shear_median']),
            share(each['ok']), share(each['field']),
        ]
        for name, each in families.items()
    ]  # fmt: skip
    return table(heads, rows)


def _broad(broad: Mapping[str, Any]) -> str:
    heads = ['model', 'contact', 'told [N]', 'misplaced', 'interval holds', 'ok']
    rows = [
        [
            name, each['contact'], f'{each["told_n"]:.2f}', share(each['misplaced']),
            'yes' if each['held'] == 1 else 'no', 'yes' if each['ok'] else 'no',
        ]
        for name, found in broad.items() for each in found
    ]  # fmt: skip
    return table(heads, rows)


def _disturbed(disturbed: Mapping[str, Mapping[str, float]]) -> str:
    plain = disturbed['undisturbed']
    heads = ['picture', 'misplaced', 'times', 'aRMSE [N]', 'times', 'total rms [N]', 'times', 'ok', 'worst while ok']
    rows = [
        [
            name, share(each['misplaced']), _times(each, plain, 'misplaced'), f'{each["armse_n"]:.4f}',
            _times(each, plain, 'armse_n'), f'{each["total_rms_n"]:.3f}', _times(each, plain, 'total_rms_n'),
            share(each['ok']), f'{each["worst_while_ok"]:.1f}',
        ]
        for name, each in disturbed.items()
    ]  # fmt: skip
    return table(heads, rows)


def _times(each: Mapping[str, float], plain: Mapping[str, float], name: str) -> str:
    return f'{each[name] / plain[name]:.2f}'


def share(value: float) -> str:
    return f'{100 * value:.1f} %' if math.isfinite(value) else '–'


def _best(tell: Callable[[Mapping[str, Any]], str]) -> Callable[[Mapping[str, Any]], dict[str, str]]:
    """An aim of the best model."""
    return lambda result: {'reached': tell(result['models'][BEST])}


def _misplaced(result: Mapping[str, Any]) -> dict[str, str]:
    names = (f'field, {presses or "no"} presses' for presses in PRESSES)
    return {'reached': ' / '.join(share(result['models'][name]['misplaced']) for name in names)}


def _over_dis(result: Mapping[str, Any]) -> dict[str, str]:
    def told(each: Mapping[str, float]) -> str:
        return '; '.join(f'{each[time] / result["dis_ms"]:.2f}' for time in ('cpu_ms', 'cpu_95_ms'))

    compiled = result['models'].get(f'{BEST}, compiled')
    return {'reached': told(result['models'][BEST]) + (f' (compiled {told(compiled)})' if compiled else '')}


def _shares(*names: str) -> Callable[[Mapping[str, Any]], dict[str, str]]:
    return _best(lambda each: '; '.join(share(each[name]) for name in names))


AIMS = (
    Aim('misplaced force, 100 presses / 10 / none', '10 % / 12 % / 15 %', _misplaced),
    Aim('aRMSE over bins', '0.009 N', _best(lambda each: f'{each["armse_n"]:.4f} N')),
    Aim(
        'total: rms; median', '0.04 N; 2 %',
        _best(lambda each: f'{each["total_rms_n"]:.3f} N; {share(each["total_median"])}'),
    ),
    Aim('centre, median', '0.08 mm', _best(lambda each: f'{each["centre_mm_median"]:.3f} mm')),
    Aim('net shear; torsion, medians', '3 %; 5 %', _shares('shear_median', 'torsion_median')),
    Aim('map r', '0.82', _best(lambda each: f'{each["map_r"]:.2f}')),
    Aim('intervals hold: total; shear; bins', '85 to 95 %', _shares('total_held', 'shear_held', 'bins_held')),
    Aim('ok, any contact', '95 %', _shares('ok')),
    Aim('CPU over DIS: median; 95 %', '0.25; 0.5 (compiled 0.08; 0.16)', _over_dis),
    Aim('CPU of the chain over flow and readout', '1.5', _best(_surrounded)),
)  # fmt: skip
