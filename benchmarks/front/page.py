"""The page and the chart of speed against accuracy, from the numbers of `tactile bench front`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.front.profiles import JPEG, STAGES
from benchmarks.harness.report import opening, ranged, table

LABELS = {'armse_n': 'aRMSE [N]', 'd_loc_mm': 'd_loc [mm]', 'rmse_mc_n': 'RMSE_mc [N]'}
ABOUT = """\
Each frame was rendered once. All methods measured it in turn, on one thread. The readout of each method was fitted on
{train} frames (response: 40 components on 10x10 regions, 64 on finer grids; *network*: 400, 200 and 200 rectified
linear units; *axisymmetric*: the readout of `portable`). It was scored on {test} other frames with other rest images.
*CPU* and *wall* are medians for a frame in contact, from image to force, with the interquartile range. *at rest* is the
CPU time of an untouched frame, without the quick test that would skip it (untouched.md). *memory* is the memory that
measuring adds to a process. Errors are larger than those of the models that ship (accuracy.md), which were trained on
more frames: compare within the table only. One frame of {test} in a neighbouring bin instead of its own changes d_loc
by {step_mm:.3f} mm. Smaller differences are due to chance.

In the chart the shipped models have the times of the *chain* below, all others those of this table."""
SHIPPED = """\
The models as they ship, trained on many more frames, on the same test frames. *compiled*: Numba compiles the inner
loops of flow and readout, as a launch does by default. *flow and readout*: each model processes ten frames of a sensor
in sequence, so that the processor's caches are warm in all but the first, as in live sensing. *chain*: all that a
launch does from image to force message, without its bus. Each press of the test frames is held for five frames after
four without contact, and the last one is timed. `paper` measures motion with DIS ultrafast at scale 1, the fastest
preset that costs no accuracy (docs/method.md). *with JPEG* adds to each chain the time to decode a JPEG of 640x480 to
grey. The targets: a chain takes at most 1.5 times as long as flow and readout, and the fastest one 1/40 of the chain of
`paper`, with at most 1/4 of its errors."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    plan = result['plan']
    about = ABOUT.format(**plan, step_mm=32 / 9 / plan['test'])
    parts = opening('Speed against accuracy', result, about, f'{result["threads"]} thread')
    parts += ['![speed against accuracy](speed_accuracy.png)', _table(result), '## Pareto front', _fronts(result)]
    parts += ['## The models that ship', SHIPPED, _profiles(result), '## Time by stage', _stages(result)]
    return '\n\n'.join(parts)


def _table(result: Mapping[str, Any]) -> str:
    heads = ['method', *LABELS.values(), 'right bin', 'CPU [ms]', 'wall [ms]', 'at rest', 'flow', 'predict',
             'memory [MB]', 'on the Pareto front of']  # fmt: skip
    rows = []
    for name, each in sorted(result['contenders'].items(), key=lambda one: one[1]['cpu_ms']['median']):
        on = [LABELS[error].split()[0] for error, front in result['fronts'].items() if name in front]
        stages = each['stages_cpu_ms']
        rows.append([
            name, f'{each["armse_n"]:.4f}', f'{each["d_loc_mm"]:.3f}', f'{each["rmse_mc_n"]:.4f}',
            f'{each["right_bin"]:.1%}', ranged(each['cpu_ms']), ranged(each['wall_ms']),
            f'{each["rest_cpu_ms"]["median"]:.2f}', f'{stages["flow and features"]:.2f}', f'{stages["predict"]:.2f}',
            f'{each["memory_mb"]:.0f}', ', '.join(on),
        ])  # fmt: skip
    return table(heads, rows)


def _profiles(result: Mapping[str, Any]) -> str:
    """Time and error of each shipped model, relative to those of `paper`."""
    shipped, decoding = result['profiles'], result['floors_cpu_ms'][JPEG]
    paper = shipped['paper']
    whole = paper['chain_cpu_ms']['median']
    rows = []
    for name, each in sorted(shipped.items(), key=lambda one: one[1]['chain_cpu_ms']['median']):
        chain = each['chain_cpu_ms']['median']
        errors = [f'{each[error]:.4f} ({_share(each[error], paper[error])})' for error in ('armse_n', 'rmse_mc_n')]
        rows.append([
            name, ranged(each['cpu_ms']), ranged(each['chain_cpu_ms']), f'{chain / each["cpu_ms"]["median"]:.2f}',
            f'1/{whole / chain:.1f}', f'1/{(decoding + whole) / (decoding + chain):.1f}', *errors,
            f'{each["d_loc_mm"]:.3f}',
        ])  # fmt: skip
    heads = ['model', 'flow and readout, CPU [ms]', 'chain, CPU [ms]', 'chain / flow and readout', 'chain / paper',
             'with JPEG / paper', 'aRMSE [N] (/ paper)', 'RMSE_mc [N] (/ paper)', 'd_loc [mm]']  # fmt: skip
    return table(heads, rows)


def _share(part: float, whole: float) -> str:
    return f'{part / whole:.2f}' if whole else '–'


def _stages(result: Mapping[str, Any]) -> str:
    """CPU time of each stage, and of basic operations for comparison."""
    shipped = sorted(result['profiles'].items(), key=lambda one: one[1]['cpu_ms']['median'])
    rows = [[name, *(f'{each["stages_cpu_ms"][stage]:.3f}' for stage in STAGES)] for name, each in shipped]
    floors = [[name, f'{ms:.3f}'] for name, ms in result['floors_cpu_ms'].items()]
    return '\n\n'.join(
        [table(['model', *(f'{stage} [ms]' for stage in STAGES)], rows), table(['for comparison', '[ms]'], floors)]
    )


def _fronts(result: Mapping[str, Any]) -> str:
    """The methods on the Pareto front of each error, and the methods on none."""
    on_any = {name for front in result['fronts'].values() for name in front}
    lines = [f'- {LABELS[error]}: {"; ".join(front)}' for error, front in result['fronts'].items()]
    ways = {each['way'] for each in result['contenders'].values()}
    never = sorted(ways - {result['contenders'][name]['way'] for name in on_any})
    lines.append(f'- on none of these fronts, with any grid: {"; ".join(never) if never else "–"}')
    return '\n'.join(lines)
