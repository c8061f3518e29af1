"""The results of the failure bench as a page of documentation: aims first, then each family, then what still wins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from benchmarks.harness.declaration import Aim, reached
from benchmarks.harness.report import opening, shown, table
from benchmarks.stability.aims import AIMS, Judge, Point, Verdict, losers, points_of
from benchmarks.stability.floor import least_ratio

FAMILIES = {
    'light': 'Light, before the camera makes a picture of it.',
    'optics': 'Lens and camera.',
    'geometry': 'Camera and gel, moved, turned or changed after the rest image was taken, or before where it says so.',
    'pattern': 'Markers that lose their light after the rest image was taken.',
    'motion': (
        'How things press. The simulated gel is tabulated to 2.5 mm of the tip; a drag sticks, is linear, and adds '
        'to the normal press; a fast press is seen as the mean of two moments of its exposure, and the truth is that '
        'of its middle; the gel answers at once.'
    ),
    'contact': (
        'What presses, and where. Motions of several contacts add up, and so do their forces; the layer has no sides, '
        'so that its own edge (16 mm from the middle) is that of its markers only.'
    ),
    'time': 'When frames arrive and what their stamps say. Every force is compared with the truth of its own frame.',
    'rest image': 'What is wrong with the rest image, or with the gel since it was taken.',
    'numbers': 'Numbers that are none, or at the end of their range.',
}
INTRODUCTION = """\
A simulated sensor takes its rest image (16 frames); something goes wrong at rest; presses at random places and depths
(0.3 to 1.9 mm) are held and go, at rest after each; it ends. Every profile gets the same pictures, through the plain
objects that the live nodes run, drift monitor and all. All of it is simulation.

*Error* is the root mean square of total force minus truth on held frames, in N, and in brackets what it is of the
undisturbed stream's; *while ok* the same over those frames whose status is ok, in units of the nominal error, which
`ok` is measured by (docs/stability.md); *place* the median distance of a contact; *missed* the share of contacts that
none was told for; *false* the largest force told as a contact while nothing touches, and the share of frames at rest in
which one was; *status* the shares of frames that say ok, degraded and invalid (in every stream the first frame of each
contact is degraded, as it may have been caught moving, which is one in ten, and does not count as said); *sigma* the
median uncertainty over the undisturbed one, and in brackets the error in units of it; *said after* and *invalid after*
the number of the first frame after the cause that is not ok, and is invalid (1: at once; of light that fades from where
a seventh of it is left); *left after* the last one after its end that is still invalid. Bold: a force that is off by
more than twice the nominal error, or a false contact above 20 mN, with status ok."""

FLOOR = """\
Least standard deviation of the force that any unbiased method could read from one such picture with its noise (the
Cramér-Rao bound, place, depth and rest image's noise included, all else known: `benchmarks/stability/floor.py`), beside
what was measured in one picture: the first that is held of each press. In brackets, by how much each profile's error
would grow if it grew by no more than that: the nearer a profile is to the floor undisturbed, the more of its error is
noise, and the more times noise makes it worse. At the floor itself four times the noise is four times the error. After
the semicolon the error over the whole hold, and what that is of the undisturbed one's."""


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    points = points_of(result)
    plan = result['plan']
    more = (
        f'{plan["presses"]} presses a stream, {plan["hold"]} frames each, {plan["fps"]:g} frames a second; '
        f'{len(points)} streams'
    )
    parts = opening('The failure bench', result, INTRODUCTION, more)
    aims = [_aim(name, judge) for name, judge in AIMS.items()]
    parts += ['## What was to be reached', reached(aims, result), _undisturbed(result)]
    if floors := _floors(result):
        parts += ['## What one picture can tell', FLOOR, floors]
    for family in dict.fromkeys(each['family'] for each in result['cases']):
        parts += [f'## {family[0].upper()}{family[1:]}', FAMILIES[family], f'![{family}]({picture_of(family)})']
        for profile in result['profiles']:
            parts += [f'### {family[0].upper()}{family[1:]}, `{profile}`', _family(points, family, profile)]
    return '\n\n'.join([*parts, '## The disturbances that still win', *_losers(result, points)])


def picture_of(family: str, name: str = 'stability') -> str:
    """The file name of a family's plot."""
    return f'{name}_{family.replace(" ", "_")}.png'


def _aim(name: str, judge: Judge) -> Aim:
    """An aim of each profile, as 'light ±30 %: within 1.5x' names it."""
    figure, _, to_reach = name.partition(': ')

    def told(result: Mapping[str, Any]) -> dict[str, str]:
        points = points_of(result)
        return {each: _verdict(judge([p for p in points if p.profile == each])) for each in result['profiles']}

    return Aim(figure, to_reach or 'in every stream', told)


def _verdict(found: Verdict | None) -> str:
    if found is None:
        return 'not measured'
    held = 'held' if found.held == found.judged else f'**not held**, at {found.held} of {found.judged}'
    return held if found.held == found.judged and not found.worst else f'{held}; {found.worst}'


def _undisturbed(result: Mapping[str, Any]) -> str:
    heads = ['undisturbed', 'error, N', 'place, mm', 'missed', 'largest N at rest', 'ok', 'sigma, N', 'error in sigmas']
    rows = [
        [name, _n(each['rmse_n']), _mm(each['place_mm']), f'{each["missed"]:.0%}', _n(each['rest_n']),
         f'{each["ok"]:.0%}', _n(each['sigma_n']), _sigmas(each['error_sigmas'])]
        for name, each in result['undisturbed'].items()
    ]  # fmt: skip
    return table(heads, rows)


def _floors(result: Mapping[str, Any]) -> str:
    """Of the disturbances in which errors shall hold; nothing if none was asked for."""
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
    """'5.4 (2.7x, least 1.4x); 3.5 (1.8x)'."""
    first, usual_n = score['first_rmse_n'], undisturbed['first_rmse_n']
    whole = f'{_mn(score["rmse_n"])} ({_times(_ratio(score["rmse_n"], undisturbed["rmse_n"]))})'
    least = _times(least_ratio(usual_n, floor_n, least_n) if usual_n else None)
    return f'{_mn(first)} ({_times(_ratio(first, usual_n))}, least {least}); {whole}'


def _ratio(value: float | None, of: float | None) -> float | None:
    return value / of if value is not None and of else None


HEADS = (
    'disturbance', 'error, N', 'while ok', 'place, mm', 'missed', 'false, N', 'ok / degraded / invalid',
    'sigma (error in it)', 'said after', 'invalid after', 'left after', 'reasons',
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
        parts += [f'`{profile}`:', '\n'.join(lines) if lines else 'None of those above.']
    return parts


_n, _mm, _times, _sigmas, _count, _milli = (
    partial(shown, form=form, none='-') for form in ('{:.4f}', '{:.3f}', '{:.1f}x', '{:.1f}', '{}', '{:.2g}')
)


def _mn(value: float | None) -> str:
    return _milli(None if value is None else 1e3 * value)
