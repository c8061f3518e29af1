"""The page on frames in which nothing touches: tables from the numbers of `tactile bench untouched`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.harness.report import opening, table

INTRODUCTION = """\
A look at each image decides whether anything touches or has changed (`tactile_nodes/sensing/picture/stillness.py`);
where nothing has, the flow features node answers with no motion and the force estimator with 0 N, without flow and
network.
All of it is simulation. *motion* is the number that decides, in units of what noise makes of it: a frame is still up to
{limit:g}. Of still frames one in {full_every} is measured all the same; the first two tables leave that out, the last
has it."""
TOUCHES = """\
Touches at random places within 27x27 mm, where the paper presses; *in corners*: 13 to 14 mm from the middle along both
axes, the farthest that training presses. A missed touch is one that is called still; a false alarm a frame at rest that
is not, which costs time and nothing else. `stiff` is half as hard again, so a force moves it less; `thin` is thinner;
`lifelike` sends JPEG, and its camera and light sit a little askew."""
DISTURBED = """\
Whatever changes the picture must go on to flow and model, which have their own ways to hold or to say so; a change of
light of up to 3 % may pass, since the look is blind to it. A small disturbance must not hide a touch either."""
MINUTE = """\
Presses of 0.25 to 2 mm every two seconds, with pauses between, 60 frames a second; each frame answered with the look
and without, in turn. CPU time from the image to the force, on one thread, without the bus."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    return '\n\n'.join(
        [
            *opening('Frames in which nothing touches', result, INTRODUCTION.format(**result['options'])),
            '## Missed touches and false alarms', TOUCHES, _touches(result['gels']),
            '## Disturbances', DISTURBED, _disturbances(result['disturbances']),
            '## What it saves', MINUTE, _minute(result['minute']),
        ]
    )  # fmt: skip


def _touches(gels: Mapping[str, Any]) -> str:
    rows = []
    for name, each in gels.items():
        rest = each['rest']
        alarms = rest['count'] - rest['within']
        rows.append([f'{name}, at rest', str(rest['count']), f'{alarms} ({alarms / rest["count"]:.1%}) alarms',
                     *_spread(rest)])  # fmt: skip
        told = {f'{1e3 * float(force):g} mN': touches for force, touches in each['touches'].items()}
        for label, touches in {**told, '20 mN in corners': each['corners']}.items():
            missed = f'{touches["within"]} ({touches["within"] / touches["count"]:.1%}) missed'
            rows.append([f'{name}, {label}', str(touches['count']), missed, *_spread(touches)])
    return table(['gel', 'frames', 'wrong', 'least motion', 'median', 'most'], rows)


def _spread(found: Mapping[str, float]) -> list[str]:
    return [f'{found[name]:.1f}' for name in ('least', 'median', 'most')]


def _disturbances(found: Mapping[str, Mapping[str, float]]) -> str:
    rows = [[name, f'{each["measured"]:.0%}', f'{each["missed"]:.0%}'] for name, each in found.items()]
    return table(['disturbance', 'at rest: measured', 'touches of 20 mN: missed'], rows)


def _minute(found: Mapping[str, Any]) -> str:
    first = next(iter(found.values()))
    said = (
        f'{first["frames"]} frames, {first["touching"]} of them with contact. Called still: {first["untouched"]}, of '
        f'which {first["untouched_at_rest"]} without any contact; missed from 20 mN on: {first["missed_20_mn"]}; the '
        f'hardest touch called still: {1e3 * first["most_missed_n"]:.1f} mN.'
    )
    heads = ['model', 'look', 'at rest [ms]', 'in contact [ms]', 'the minute [s]', 'share', 'force RMSE [N]']
    rows = [
        [
            model, look, f'{each["rest_ms"][look]:.3f}', f'{each["touch_ms"][look]:.3f}', f'{each["cpu_s"][look]:.2f}',
            f'{each["cpu_s"][look] / each["cpu_s"]["without"]:.0%}', f'{each["rmse_n"][look]:.4f}',
        ]
        for model, each in found.items() for look in ('without', 'with')
    ]  # fmt: skip
    same = all(each['same_when_measured'] for each in found.values())
    end = 'Frames that are measured have the same force, bit for bit.' if same else 'SOME MEASURED FRAMES DIFFER.'
    return f'{said}\n\n{table(heads, rows)}\n\n{end}'
