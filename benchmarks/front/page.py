"""The page and the chart of speed against accuracy, from the numbers of `tactile bench front`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.front.profiles import JPEG, MEDIUM, STAGES
from benchmarks.harness.report import opening, ranged, table

LABELS = {'armse_n': 'aRMSE [N]', 'd_loc_mm': 'd_loc [mm]', 'rmse_mc_n': 'RMSE_mc [N]'}
ABOUT = """\
Every frame was rendered once and measured by all, in turn, on one thread. From {train} frames each contender's readout
was fitted (the response of the profiles: 40 components on 10x10 regions, 64 on finer ones; *network*: 400, 200 and 200
rectified units), on {test} others with rest images of their own it was scored. *CPU* and *wall* are medians of a frame
in contact, from image to force, with the range of the middle half; *at rest* is CPU time where nothing touches, without
the look that would spare it (untouched.md). *memory* is what measuring adds to a process. Fewer frames than the models
that ship were trained on, so errors are larger than theirs (accuracy.md); compare within the table. One frame of {test}
in a neighbouring bin instead of its own changes d_loc by {step_mm:.3f} mm: smaller differences are chance."""
SHIPPED = """\
As they ship, trained on many more frames, on the same test frames: ten frames of a sensor by one, then by the next, so
that each but the first finds in the processor's caches what it needs, as it does live. *compiled*: the inner loops of
flow and readout by numba (`compiled:=true`). `paper` measures motion by DIS ultrafast at scale 1, the fastest preset
that costs no accuracy (docs/method.md); the paper names none. The last row has its features by the preset that is used
most. How many times faster the others are is told of both, from decoded images and with what decoding a JPEG of 640x480
to grey takes added to each. The aims: a fiftieth of the time of `paper` at no more than a quarter of its errors, a
fifteenth at a seventh, and a fifteenth for the fastest with JPEG."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    plan = result['plan']
    about = ABOUT.format(**plan, step_mm=32 / 9 / plan['test'])
    parts = opening('Speed against accuracy', result, about, f'{result["threads"]} thread')
    parts += ['![speed against accuracy](speed_accuracy.png)', _table(result), '## The front', _fronts(result)]
    parts += ['## The models that ship', SHIPPED, _profiles(result), "## Where a frame's time goes", _stages(result)]
    return '\n\n'.join(parts)


def _table(result: Mapping[str, Any]) -> str:
    heads = ['contender', *LABELS.values(), 'right bin', 'CPU [ms]', 'wall [ms]', 'at rest', 'flow', 'predict',
             'memory [MB]', 'on the front of']  # fmt: skip
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
    """Time and error of each model that ships, over those of `paper`."""
    shipped = result['profiles']
    paper, medium = shipped['paper'], shipped[MEDIUM]
    rows = []
    for name, each in sorted(shipped.items(), key=lambda one: one[1]['cpu_ms']['median']):
        cpu = each['cpu_ms']['median']
        errors = [
            f'{each[error]:.4f} ({_share(each[error], paper[error])})' if error in each else '–'
            for error in ('armse_n', 'rmse_mc_n', 'd_loc_mm')
        ]
        times = [
            f'1/{(decoding + whole["cpu_ms"]["median"]) / (decoding + cpu):.1f}'
            for decoding in (0.0, result['floors_cpu_ms'][JPEG])
            for whole in (paper, medium)
        ]
        rows.append([name, ranged(each['cpu_ms']), *times, *errors])
    heads = ['model', 'CPU [ms]', 'of paper', f'of {MEDIUM}', 'with JPEG', f'with JPEG, of {MEDIUM}',
             'aRMSE [N] (of paper)', 'RMSE_mc [N] (of paper)', 'd_loc [mm] (of paper)']  # fmt: skip
    return table(heads, rows)


def _share(part: float, whole: float) -> str:
    return f'{part / whole:.2f}' if whole else '–'


def _stages(result: Mapping[str, Any]) -> str:
    """CPU time of each stage, and of the least that anybody could do."""
    shipped = sorted(result['profiles'].items(), key=lambda one: one[1]['cpu_ms']['median'])
    rows = [[name, *(f'{each["stages_cpu_ms"][stage]:.3f}' for stage in STAGES)] for name, each in shipped]
    floors = [[name, f'{ms:.3f}'] for name, ms in result['floors_cpu_ms'].items()]
    return '\n\n'.join(
        [table(['model', *(f'{stage} [ms]' for stage in STAGES)], rows), table(['beside them', '[ms]'], floors)]
    )


def _fronts(result: Mapping[str, Any]) -> str:
    """The front of each error in words, and what is not on any."""
    on_any = {name for front in result['fronts'].values() for name in front}
    lines = [f'- {LABELS[error]}: {"; ".join(front)}' for error, front in result['fronts'].items()]
    ways = {each['way'] for each in result['contenders'].values()}
    never = sorted(ways - {result['contenders'][name]['way'] for name in on_any})
    lines.append(f'- on none of them, with any grid: {"; ".join(never) if never else "no way"}')
    return '\n'.join(lines)
