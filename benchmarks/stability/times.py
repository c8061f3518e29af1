"""Frames that are lost, doubled, late or out of order, and stamps that jump."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.stability.stream import CAPTURE, DURING, HELD, MOVING, Change, Moment, Presses
from tactile_nodes.clock import NS_PER_S

Moments = list[Moment]


def dropped(moments: Moments, percent: float) -> Moments:
    """Random frames never arrive."""
    lost = np.random.default_rng(5).random(len(moments)) < percent / 100
    return [each for each, gone in zip(moments, lost, strict=True) if each.part != DURING or not gone]


def doubled(moments: Moments, percent: float) -> Moments:
    """Random frames arrive twice, with the same stamp."""
    twice = np.random.default_rng(6).random(len(moments)) < percent / 100
    return [
        each
        for moment, again in zip(moments, twice, strict=True)
        for each in [moment] * (2 if again and moment.part == DURING else 1)
    ]


def reordered(moments: Moments, by_frames: float) -> Moments:
    """One frame in three arrives late by `by_frames`."""
    places = [
        place + (by_frames + 0.5 if each.part == DURING and each.number % 3 == 0 else 0)
        for place, each in enumerate(moments)
    ]
    return [moments[each] for each in np.argsort(places, kind='stable')]


def late(moments: Moments, by_s: float) -> Moments:
    """Every frame arrives `by_s` after its capture."""
    return [dataclasses.replace(each, age_s=by_s) if each.part == DURING else each for each in moments]


def paced(moments: Moments, fps: float) -> Moments:
    """Another frame rate, from the start."""
    first_ns = moments[0].stamp_ns
    return [
        dataclasses.replace(each, stamp_ns=first_ns + round(place * NS_PER_S / fps))
        for place, each in enumerate(moments)
    ]


def jumped(moments: Moments, by_s: float) -> Moments:
    """The stamps of all frames of the disturbance have an offset of `by_s`."""
    return [
        dataclasses.replace(each, stamp_ns=each.stamp_ns + round(by_s * NS_PER_S)) if each.part == DURING else each
        for each in moments
    ]


def stood_still(moments: Moments, _: float) -> Moments:
    """All frames of the disturbance have the same stamp, that of the first."""
    first_ns = next(each.stamp_ns for each in moments if each.part == DURING)
    return [dataclasses.replace(each, stamp_ns=first_ns) if each.part == DURING else each for each in moments]


def caught_once(moments: Moments, speed_mm_s: float) -> Moments:
    """Each tip moves down at constant speed and up again; only one frame shows it at the depth of the hold.

    The frames before show it at the height that follows from this speed.
    """
    arrived: dict[int, Moment] = {}
    for each in moments:
        if each.kind == HELD:
            arrived.setdefault(each.press, each)
    return [_coming(each, arrived, speed_mm_s) for each in moments if each.kind != HELD or each is arrived[each.press]]


def pressed_slowly(moments: Moments, speed_mm_s: float) -> Moments:
    """Each tip moves down at constant speed during the hold; the last frame shows it at the depth of the hold."""
    last_ns: dict[int, int] = {each.press: each.stamp_ns for each in moments if each.kind == HELD}
    return [
        dataclasses.replace(
            each,
            presses=_raised(each.presses, speed_mm_s * (last_ns[each.press] - each.stamp_ns) / NS_PER_S),
        )
        if each.kind == HELD
        else each
        for each in moments
    ]


def _coming(moment: Moment, arrived: dict[int, Moment], speed_mm_s: float) -> Moment:
    there = arrived.get(moment.press)
    if moment.kind != MOVING or there is None or moment.stamp_ns >= there.stamp_ns:
        return moment
    above_mm = speed_mm_s * (there.stamp_ns - moment.stamp_ns) / NS_PER_S
    return dataclasses.replace(moment, presses=_raised(there.presses, above_mm))


def _raised(presses: Presses, by_mm: float) -> Presses:
    return tuple(dataclasses.replace(each, depth_mm=each.depth_mm - by_mm) for each in presses)


def begun_late(moments: Moments, by_s: float) -> Moments:
    """A pause between rest image and sensing."""
    return [
        each if each.kind == CAPTURE else dataclasses.replace(each, stamp_ns=each.stamp_ns + round(by_s * NS_PER_S))
        for each in moments
    ]


def _when(course: Callable[[Moments, float], Moments]) -> Callable[[float], Change]:
    return lambda level: Change(course=partial(_with, course, level))


def _with(course: Callable[[Moments, float], Moments], level: float, moments: Moments) -> Moments:
    return course(moments, level)


TIMES = (
    ('frames dropped', '%', (50.0, 90.0), _when(dropped)),
    ('frames doubled', '%', (50.0,), _when(doubled)),
    ('frames out of order', 'frames late', (5.0,), _when(reordered)),
    ('frames late', 's', (0.3, 2.0), _when(late)),
    ('frame rate', 'fps', (15.0, 60.0, 240.0), _when(paced)),
    ('stamps jump', 's', (60.0, -0.5, -60.0), _when(jumped)),
    ('stamps stand still', '', (0.0,), _when(stood_still)),
    ('a pause after the rest image', 's', (3600.0,), _when(begun_late)),
)
