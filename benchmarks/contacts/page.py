"""The page of the bench of contacts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.contacts import BEST
from benchmarks.report import machine_and_commit, named_versions, table

ABOUT = """\
{frames} contacts of ten families (seed {seed}), most of them dragged, some twisted, solved at finite strain with
friction; up to 3 N, the tip up to 1 N. *Misplaced* is half the sum over the bins of |told - true|, over the true
total. *Total* is the normal force: root mean square, and median of |told - true| over the true one. *Centre* is the
median distance of the centres of pressure, *shear* the median error of the net shear where that exceeds 50 mN,
*torsion* that of a single contact where it exceeds 1 N mm. *Map r* is the correlation with the true pressure on 27x27
cells. *Held* is the share of 90 % intervals that hold the truth (a bin counts where it has 1 % of the force, told or
true). *Worst while ok* is the largest error of a total over the model's nominal one. CPU is the whole chain on one
thread, as a share of OpenCV's DIS (medium) in the same run ({dis_ms:.1f} ms): median and 95th percentile. Inner loops
are numpy's, but for what is called compiled: by numba, where that is installed, read by itself after the others."""

BROAD = """\
Under the middle of a contact that is wide beside the layer's 6 mm next to nothing moves. To be reached: told within
20 %, with intervals that hold, and never nothing."""

TICKS_MS = 5, 10, 20, 50, 100

REACH = {
    'misplaced force, 100 presses / 10 / none': '10 % / 12 % / 15 %',
    'aRMSE over bins': '0.009 N',
    'total: rms; median': '0.04 N; 2 %',
    'centre, median': '0.08 mm',
    'net shear; torsion, medians': '3 %; 5 %',
    'map r': '0.82',
    'intervals hold: total; shear; bins': '85 to 95 %',
    'ok, any contact': '95 %',
    'CPU over DIS: median; 95 %': '0.25; 0.5 (compiled 0.08; 0.16)',
}


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    models = result['models']
    about = ABOUT.format(frames=next(iter(models.values()))['frames'], seed=result['seed'], dis_ms=result['dis_ms'])
    parts = [
        '# Any contact', f'```console\n$ {result["command"]}\n```', about,
        f'{machine_and_commit(result)}; {named_versions(result)}.',
        '![misplaced force and error of the total against CPU time](contacts.png)',
        _models(result), '## What was to be reached', _reach(result),
        '## Family by family, `field` with 100 presses', _families(models[BEST]['families']),
    ]  # fmt: skip
    parts += ['## Broad contacts', BROAD, _broad(result['broad'])]
    if result['disturbed']:
        parts += ['## In disturbed pictures, `field` with 100 presses', _disturbed(result['disturbed'])]
    return '\n\n'.join(parts)


def draw(result: Mapping[str, Any], file: Path) -> None:
    """Speed against accuracy of any contact: CPU time of a frame (median, line to the 95th percentile) and two errors.

    Raises:
        ConfigurationError: matplotlib is not installed.
        DatasetError: the file cannot be written.
    """
    from tactile_nodes.learning.figures import figure, save

    drawn = figure(11.0, 4.5)
    errors = {'misplaced': 'force in wrong bins [%]', 'total_median': 'error of the total, median [%]'}
    for axis, (error, label) in zip(drawn.subplots(1, 2), errors.items(), strict=True):
        for name, each in result['models'].items():
            dot = axis.plot(each['cpu_ms'], 100 * each[error], 'o', label=name)[0]
            axis.plot(
                [each['cpu_ms'], each['cpu_95_ms']], [100 * each[error]] * 2, color=dot.get_color(), linewidth=0.8
            )
        axis.axvline(result['dis_ms'], color='grey', linestyle=':', label="OpenCV's DIS, medium, alone")
        axis.set(xlabel='CPU time of a frame in contact, image to message [ms]', ylabel=label, xscale='log')
        axis.set_xticks(TICKS_MS, [str(each) for each in TICKS_MS])
        axis.set_ylim(bottom=0)
        axis.grid(which='both', linewidth=0.3)
    axis.legend(fontsize=8)
    drawn.suptitle('Any contact: speed against accuracy (line: to the 95th percentile of the time)')
    save(drawn, file)


def _models(result: Mapping[str, Any]) -> str:
    heads = [
        'model', 'misplaced', 'aRMSE [N]', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'torsion', 'map r',
        'total held', 'shear held', 'bins held', 'ok', 'worst while ok', 'by field', 'CPU / DIS', '95 %',
    ]  # fmt: skip
    return table(heads, [[name, *_row(each, result['dis_ms'])] for name, each in result['models'].items()])


def _row(each: Mapping[str, float], dis_ms: float) -> list[str]:
    return [
        _share(each['misplaced']), f'{each["armse_n"]:.4f}', f'{each["total_rms_n"]:.3f}', _share(each['total_median']),
        f'{each["centre_mm_median"]:.3f}', _share(each['shear_median']), _share(each['torsion_median']),
        f'{each["map_r"]:.2f}', _share(each['total_held']), _share(each['shear_held']), _share(each['bins_held']),
        _share(each['ok']), f'{each["worst_while_ok"]:.1f}', _share(each['field']), f'{each["cpu_ms"] / dis_ms:.2f}',
        f'{each["cpu_95_ms"] / dis_ms:.2f}',
    ]  # fmt: skip


def _reach(result: Mapping[str, Any]) -> str:
    models, best = result['models'], result['models'][BEST]
    compiled = models.get(f'{BEST}, compiled')
    rows = {
        'misplaced force, 100 presses / 10 / none': ' / '.join(
            _share(models[f'field, {name} presses']['misplaced']) for name in ('100', '10', 'no')
        ),
        'aRMSE over bins': f'{best["armse_n"]:.4f} N',
        'total: rms; median': f'{best["total_rms_n"]:.3f} N; {_share(best["total_median"])}',
        'centre, median': f'{best["centre_mm_median"]:.3f} mm',
        'net shear; torsion, medians': f'{_share(best["shear_median"])}; {_share(best["torsion_median"])}',
        'map r': f'{best["map_r"]:.2f}',
        'intervals hold: total; shear; bins': '; '.join(
            _share(best[name]) for name in ('total_held', 'shear_held', 'bins_held')
        ),
        'ok, any contact': _share(best['ok']),
        'CPU over DIS: median; 95 %': _cpu(best, result['dis_ms'])
        + (f' (compiled {_cpu(compiled, result["dis_ms"])})' if compiled else ''),
    }
    return table(['figure', 'to reach', 'reached'], [[name, REACH[name], found] for name, found in rows.items()])


def _cpu(each: Mapping[str, float], dis_ms: float) -> str:
    return f'{each["cpu_ms"] / dis_ms:.2f}; {each["cpu_95_ms"] / dis_ms:.2f}'


def _families(families: Mapping[str, Mapping[str, float]]) -> str:
    heads = ['family', 'misplaced', 'aRMSE [N]', 'total rms [N]', 'median', 'centre [mm]', 'shear', 'ok', 'by field']
    rows = [
        [
            name, _share(each['misplaced']), f'{each["armse_n"]:.4f}', f'{each["total_rms_n"]:.3f}',
            _share(each['total_median']), f'{each["centre_mm_median"]:.3f}', _share(each['shear_median']),
            _share(each['ok']), _share(each['field']),
        ]
        for name, each in families.items()
    ]  # fmt: skip
    return table(heads, rows)


def _broad(broad: Mapping[str, Any]) -> str:
    heads = ['model', 'contact', 'told [N]', 'misplaced', 'interval holds', 'ok']
    rows = [
        [
            name, each['contact'], f'{each["told_n"]:.2f}', _share(each['misplaced']),
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
            name, _share(each['misplaced']), _times(each, plain, 'misplaced'), f'{each["armse_n"]:.4f}',
            _times(each, plain, 'armse_n'), f'{each["total_rms_n"]:.3f}', _times(each, plain, 'total_rms_n'),
            _share(each['ok']), f'{each["worst_while_ok"]:.1f}',
        ]
        for name, each in disturbed.items()
    ]  # fmt: skip
    return table(heads, rows)


def _times(each: Mapping[str, float], plain: Mapping[str, float], name: str) -> str:
    return f'{each[name] / plain[name]:.2f}'


def _share(value: float) -> str:
    return f'{100 * value:.1f} %' if math.isfinite(value) else '–'
