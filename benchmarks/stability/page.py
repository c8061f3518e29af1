"""The page of the stability benchmark: targets first, then each family, then the disturbances that still fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, shown, table
from benchmarks.stability.aims import AIMS, Judge, Point, Verdict, losers, points_of
from benchmarks.stability.floor import least_ratio

FAMILIES = {
    'light': 'The light that reaches the camera.',
    'optics': 'Lens and camera.',
    'geometry': 'Camera or gel moved, turned or changed after the capture of the rest image, or before it if stated.',
    'pattern': 'Markers that lose their light after the rest image was taken.',
    'motion': (
        'How bodies press. The simulation has tables of the gel down to 2.5 mm of the tip. A drag sticks, is linear, '
        'and adds to the normal press. A fast press is drawn as the mean of two moments of its exposure; its true '
        'force is that of the middle of the exposure. The gel responds without delay.'
    ),
    'contact': (
        'What presses, and where. Motions of several contacts add up, and so do their forces. The layer has no sides: '
        'at its edge, 16 mm from the middle, only the markers end.'
    ),
    'time': 'When frames arrive, and with which stamps. Every force is compared with the truth of its own frame.',
    'rest image': 'Faults of the rest image, or changes of the gel since its capture.',
    'numbers': 'Values that are not finite, or at the end of their range.',
}
INTRODUCTION = """\
Each stream is one simulated run. The sensor captures its rest image (16 frames). Then a disturbance begins while
nothing touches. Presses at random places and depths (0.3 to 1.9 mm) are held, each followed by rest. Then the
disturbance ends. Every profile gets the same pictures, through the same objects that the live nodes run, including the
drift monitor.

- *error*: root mean square error of the total force on held frames, in N; in brackets, relative to the undisturbed
  stream
- *while ok*: the same over the frames whose status is ok, as a multiple of the nominal error, which defines `ok`
  (docs/stability.md)
- *place*: median distance between estimated and true place of a contact
- *missed*: share of contacts that were not reported
- *false*: largest force reported as a contact while nothing touches, and the share of frames at rest with such a
  contact
- *ok / degraded / invalid*: shares of frames by status. The first frame of a contact may be degraded (`beginning`),
  because the contact may still be moving. This does not count as detected.
- *sigma*: median standard deviation, relative to the undisturbed stream; in brackets, the error divided by the standard
  deviation
- *detected after*, *invalid after*: number of the first frame after the cause that is not ok, or is invalid (1: at
  once; light that fades is counted from the frame in which a seventh of it is left)
- *recovered after*: number of the last frame after the end of the disturbance that is still invalid
- bold: with status ok, a force error of more than twice the nominal error, or a false contact above 20 mN"""

FLOOR = """\
*Floor* is the least standard deviation of the force that any unbiased method can have from one such picture with its
noise (the Cramér-Rao bound: place, depth and the noise of the rest image are unknown, all else is known; see
`benchmarks/stability/floor.py`). *First frame* is the error measured in the first held picture of each press. In
brackets: its ratio to the undisturbed error, and the least ratio that the floor allows. The nearer an undisturbed
profile is to the floor, the more of its error is noise, and the more does added noise increase it. At the floor itself,
four times the noise is four times the error. *Hold* is the error over the whole hold, with its ratio to the undisturbed
error."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    points = points_of(result)
    plan = result['plan']
    more = (
        f'{plan["presses"]} presses per stream, {plan["hold"]} frames each, {plan["fps"]:g} frames a second; '
        f'{len(points)} streams'
    )
    parts = opening('Robustness to disturbances', result, INTRODUCTION, more)
    aims = [_aim(name, judge) for name, judge in AIMS.items()]
    parts += ['## Targets', reached(aims, result), _undisturbed(result)]
    if floors := _floors(result):
        parts += ['## Lower bound for one picture', FLOOR, floors]
    for family in dict.fromkeys(each['family'] for each in result['cases']):
        parts += [f'## {family[0].upper()}{family[1:]}', FAMILIES[family], f'![{family}]({picture_of(family)})']
        for profile in result['profiles']:
            parts += [f'### {family[0].upper()}{family[1:]}, `{profile}`', _family(points, family, profile)]
    return '\n\n'.join([*parts, '## Failures that remain', *_losers(result, points)])


def picture_of(family: str, name: str = 'stability') -> str:
    """The file name of a family's plot."""
    return f'{name}_{family.replace(" ", "_")}.png'


def _aim(name: str, judge: Judge) -> Aim:
    """An aim for each profile, with a name such as 'light ±30 %: within 1.5x'."""
    figure, _, to_reach = name.partition(': ')

    def verdicts(result: Mapping[str, Any]) -> dict[str, str]:
        points = points_of(result)
        return {each: _verdict(judge([p for p in points if p.profile == each])) for each in result['profiles']}

    return Aim(figure, to_reach or 'all streams', verdicts)


def _verdict(found: Verdict | None) -> str:
    if found is None:
        return 'not measured'
    held = 'reached' if found.held == found.judged else f'**not reached**, in {found.held} of {found.judged}'
    return held if found.held == found.judged and not found.worst else f'{held}; {found.worst}'


def _undisturbed(result: Mapping[str, Any]) -> str:
    heads = ['undisturbed', 'error, N', 'place, mm', 'missed', 'largest N at rest', 'ok', 'sigma, N', 'error / sigma']
    rows = [
        [name, _n(each['rmse_n']), _mm(each['place_mm']), f'{each["missed"]:.0%}', _n(each['rest_n']),
         f'{each["ok"]:.0%}', _n(each['sigma_n']), _sigmas(each['error_sigmas'])]
        for name, each in result['undisturbed'].items()
    ]  # fmt: skip
    return table(heads, rows)


def _floors(result: Mapping[str, Any]) -> str:
    """A table for the disturbances in which errors must hold; empty if none was requested."""
    profiles, undisturbed = result['profiles'], result['undisturbed']
    rows = [
        [f'{case["name"]}, {point["level"]:g} {case["unit"]}', _mn(point['floor_n']),
         *(_beside(point['scores'][each], undisturbed[each], result['floor_n'], point['floor_n']) for each in profiles)]
        for case in result['cases']
        for point in case['points']
        if 'floor_n' in point
    ]  # fmt: skip
    usual = ['none', _mn(result['floor_n'])]
    usual += [
        f'{_mn(each["first_rmse_n"])}; {_mn(each["rmse_n"])}' for each in (undisturbed[name] for name in profiles)
    ]
    heads = ['disturbance', 'floor, mN', *(f'{each}, mN: first frame; hold' for each in profiles)]
    return table(heads, [usual, *rows]) if rows else ''


def _beside(score: Mapping[str, Any], undisturbed: Mapping[str, Any], floor_n: float, least_n: float) -> str:
    """Errors of first frames and of all, with their ratios: '5.4 (2.7x, least 1.4x); 3.5 (1.8x)'."""
    first, usual_n = score['first_rmse_n'], undisturbed['first_rmse_n']
    whole = f'{_mn(score["rmse_n"])} ({_times(_ratio(score["rmse_n"], undisturbed["rmse_n"]))})'
    least = _times(least_ratio(usual_n, floor_n, least_n) if usual_n else None)
    return f'{_mn(first)} ({_times(_ratio(first, usual_n))}, least {least}); {whole}'


def _ratio(value: float | None, of: float | None) -> float | None:
    return value / of if value is not None and of else None


HEADS = (
    'disturbance', 'error, N', 'while ok', 'place, mm', 'missed', 'false, N', 'ok / degraded / invalid',
    'sigma (error / sigma)', 'detected after', 'invalid after', 'recovered after', 'reasons',
)  # fmt: skip


def _family(points: Sequence[Point], family: str, profile: str) -> str:
    rows = [_row(each) for each in points if (each.family, each.profile) == (family, profile)]
    return table(list(HEADS), rows)


def _row(point: Point) -> list[str]:
    score = point.score
    while_ok = _times(point.times_ok)
    false = f'{score["false_n"]:.3f} ({score["false_share"]:.0%})' if score['false_share'] else '0'
    return [
        point.what,
        '-' if score['rmse_n'] is None else f'{score["rmse_n"]:.4f} ({_times(point.ratio)})',
        f'**{while_ok}**' if point.silently_wrong else while_ok,
        _mm(score['place_mm']),
        f'{score["missed"]:.0%}',
        f'**{false}**' if point.falsely_touched else false,
        ' / '.join(f'{100 * score[name]:.0f}' for name in ('ok', 'degraded', 'invalid')) + ' %',
        f'{_times(point.sigma_ratio)} ({_sigmas(score["error_sigmas"])})',
        *(_count(score[name]) for name in ('until_said', 'until_invalid', 'until_left')),
        ', '.join(f'{name} {share:.0%}' for name, share in list(score['reasons'].items())[:3]) or '-',
    ]


def _losers(result: Mapping[str, Any], points: Sequence[Point]) -> list[str]:
    parts = []
    for profile in result['profiles']:
        lines = [f'- {text}' for text in losers([each for each in points if each.profile == profile])]
        parts += [f'`{profile}`:', '\n'.join(lines) if lines else 'None.']
    return parts


_n, _mm, _times, _sigmas, _count, _milli = (
    partial(shown, form=form, none='-') for form in ('{:.4f}', '{:.3f}', '{:.1f}x', '{:.1f}', '{}', '{:.2g}')
)


def _mn(value: float | None) -> str:
    return _milli(None if value is None else 1e3 * value)
