"""The page on untouched frames: tables from the numbers of `tactile bench untouched`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.harness.report import opening, table

INTRODUCTION = """\
A quick test of each image decides whether anything touches or has changed
(`tactile_nodes/sensing/picture/stillness.py`). If not, the frame is *still*: the flow features node publishes no motion
and the force estimator 0 N, without computing flow and model. *motion* is the value that the test compares, as a
multiple of its noise; a frame is still up to {limit:g}. One in {full_every} still frames is measured nevertheless; this
is left out in the first two tables and included in the last. All results are simulated."""
TOUCHES = """\
Touches at random places within 27x27 mm, where the paper presses. *in corners*: 13 to 14 mm from the middle along both
axes, the largest distance of training presses. A missed touch is a touch that is classified as still. A false alarm is
a frame at rest that is not; it only costs time. `stiff` is 50 % harder, so a force moves it less. `thin` is thinner.
`lifelike` sends JPEG, and its camera and light are slightly tilted."""
DISTURBED = """\
A frame with a changed picture must be measured, because flow and model compensate for disturbances or report them. A
change of light of up to 3 % may be missed, because the test does not depend on it. A small disturbance must not hide a
touch."""
MINUTE = """\
Presses of 0.25 to 2 mm every two seconds, with pauses between, 60 frames a second. Each frame is processed with the
test and without it, in turn. CPU time from the image to the force, on one thread, without the bus."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    return '\n\n'.join(
        [
            *opening('Frames in which nothing touches', result, INTRODUCTION.format(**result['options'])),
            '## Missed touches and false alarms', TOUCHES, _touches(result['gels']),
            '## Disturbances', DISTURBED, _disturbances(result['disturbances']),
            '## Time saved', MINUTE, _minute(result['minute']),
        ]
    )  # fmt: skip


def _touches(gels: Mapping[str, Any]) -> str:
    rows = []
    for name, each in gels.items():
        rest = each['rest']
        alarms = rest['count'] - rest['within']
        rows.append([f'{name}, at rest', str(rest['count']), f'{alarms} ({alarms / rest["count"]:.1%}) alarms',
                     *_spread(rest)])  # fmt: skip
        labelled = {f'{1e3 * float(force):g} mN': touches for force, touches in each['touches'].items()}
        for label, touches in {**labelled, '20 mN in corners': each['corners']}.items():
            missed = f'{touches["within"]} ({touches["within"] / touches["count"]:.1%}) missed'
            rows.append([f'{name}, {label}', str(touches['count']), missed, *_spread(touches)])
    return table(['gel', 'frames', 'errors', 'least motion', 'median', 'largest'], rows)


def _spread(found: Mapping[str, float]) -> list[str]:
    return [f'{found[name]:.1f}' for name in ('least', 'median', 'most')]


def _disturbances(found: Mapping[str, Mapping[str, float]]) -> str:
    rows = [[name, f'{each["measured"]:.0%}', f'{each["missed"]:.0%}'] for name, each in found.items()]
    return table(['disturbance', 'at rest: measured', 'touches of 20 mN: missed'], rows)


def _minute(found: Mapping[str, Any]) -> str:
    first = next(iter(found.values()))
    summary = (
        f'{first["frames"]} frames, {first["touching"]} of them with contact. Still: {first["untouched"]}, of which '
        f'{first["untouched_at_rest"]} without any contact. Missed touches of at least 20 mN: '
        f'{first["missed_20_mn"]}. Hardest missed touch: {1e3 * first["most_missed_n"]:.1f} mN.'
    )
    heads = ['model', 'test', 'at rest [ms]', 'in contact [ms]', 'total [s]', 'share', 'force RMSE [N]']
    rows = [
        [
            model, look, f'{each["rest_ms"][look]:.3f}', f'{each["touch_ms"][look]:.3f}', f'{each["cpu_s"][look]:.2f}',
            f'{each["cpu_s"][look] / each["cpu_s"]["without"]:.0%}', f'{each["rmse_n"][look]:.4f}',
        ]
        for model, each in found.items() for look in ('without', 'with')
    ]  # fmt: skip
    same = all(each['same_when_measured'] for each in found.values())
    end = (
        'Measured frames have bit-identical forces with and without the test.'
        if same
        else 'SOME MEASURED FRAMES DIFFER.'
    )
    return f'{summary}\n\n{table(heads, rows)}\n\n{end}'
