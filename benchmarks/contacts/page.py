"""The page of `tactile bench contacts`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, table

PRESSES = 100, 10, 0
BEST = f'field, {PRESSES[0]} presses'
ABOUT = """\
{frames} contacts of ten families (seed {seed}), solved at finite strain with friction. Most are dragged, some are
twisted. Forces are up to 3 N, those of the tip up to 1 N.

- *misplaced*: half the sum over the bins of |estimated - true|, divided by the true total
- *total*, *median*: error of the normal force; root mean square, and median relative error
- *centre*: median distance between estimated and true centre of pressure
- *shear*: median relative error of the net shear, where this exceeds 50 mN
- *torsion*: the same for a single contact, where its torsion exceeds 1 N mm
- *map r*: correlation with the true pressure on 27x27 cells
- *covered*: share of true values within the 90 % intervals; bins count if their estimated or true force is at least
  1 % of the total
- *worst while ok*: largest error of the total while the status is ok, as a multiple of the model's nominal error
- *by field*: share of frames whose explanation is a force field
- *CPU / DIS*, *95 %*: CPU time of the whole chain from image to message on one thread, divided by that of OpenCV's DIS
  (medium) in the same run ({dis_ms:.1f} ms); median and 95th percentile
- *chain*: the median CPU time of the chain, divided by that of flow and readout alone

Inner loops run in NumPy. In the row *compiled* Numba compiles them; it is measured separately, after the others, if
Numba is installed."""

BROAD = """\
Under the middle of a contact that is wide compared with the 6 mm of the layer, almost nothing moves. The target: the
error is within 20 %, the intervals cover the true force, and the force is never reported as zero."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    models = result['models']
    about = ABOUT.format(frames=next(iter(models.values()))['frames'], seed=result['seed'], dis_ms=result['dis_ms'])
    parts = [
        *opening('Any contact', result, about),
        '![speed against accuracy](speed_accuracy.png)',
        _models(result), '## Targets', reached(AIMS, result),
        '## By family, `field` with 100 presses', _families(models[BEST]['families']),
    ]  # fmt: skip
    parts += ['## Broad contacts', BROAD, _broad(result['broad'])]
    if result['disturbed']:
        parts += ['## In disturbed pictures, `field` with 100 presses', _disturbed(result['disturbed'])]
    return '\n\n'.join(parts)


def _models(result: Mapping[str, Any]) -> str:
    heads = [
        'model', 'misplaced', 'aRMSE [N]', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'torsion', 'map r',
        'total covered', 'shear covered', 'bins covered', 'ok', 'worst while ok', 'by field', 'CPU / DIS', '95 %',
        'chain',
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
    """CPU time of the whole chain relative to flow and readout alone; a dash if that was not measured."""
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
    heads = ['model', 'contact', 'estimated [N]', 'misplaced', 'interval covers', 'ok']
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
    heads = ['picture', 'misplaced', 'ratio', 'aRMSE [N]', 'ratio', 'total rms [N]', 'ratio', 'ok', 'worst while ok']
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
    """The value of an aim for the best model."""
    return lambda result: {'reached': tell(result['models'][BEST])}


def _misplaced(result: Mapping[str, Any]) -> dict[str, str]:
    names = (f'field, {presses or "no"} presses' for presses in PRESSES)
    return {'reached': ' / '.join(share(result['models'][name]['misplaced']) for name in names)}


def _over_dis(result: Mapping[str, Any]) -> dict[str, str]:
    def ratios(each: Mapping[str, float]) -> str:
        return '; '.join(f'{each[time] / result["dis_ms"]:.2f}' for time in ('cpu_ms', 'cpu_95_ms'))

    compiled = result['models'].get(f'{BEST}, compiled')
    return {'reached': ratios(result['models'][BEST]) + (f' (compiled {ratios(compiled)})' if compiled else '')}


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
    Aim('coverage: total; shear; bins', '85 to 95 %', _shares('total_held', 'shear_held', 'bins_held')),
    Aim('ok, any contact', '95 %', _shares('ok')),
    Aim('CPU / DIS: median; 95 %', '0.25; 0.5 (compiled 0.08; 0.16)', _over_dis),
    Aim('CPU of the chain / flow and readout', '1.5', _best(_surrounded)),
)  # fmt: skip
