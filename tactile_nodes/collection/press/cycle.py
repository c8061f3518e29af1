"""One press: check and tare without contact, down, settle, window, up, check again. A procedure (see `actions`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_nodes.collection.actions import Go, Look, Procedure, SetTare, Switch
from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.rising import rising
from tactile_nodes.collection.press.surface import Surface
from tactile_nodes.collection.press.up import check_free
from tactile_nodes.collection.readings import Frame, change, pattern_change
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import (
    Tare,
    as_wrench,
    length,
    mean_noise,
    on_gel,
    pressing_n,
    slope,
    slope_noise,
    tare_of,
    wrenches,
)
from tactile_nodes.drivers.force_torque.contract import Sample, Wrench

LOOK_S = 0.02
STEADY_SIGMAS, FEWEST_SAMPLES = 4.0, 3
SHOWN = 1.5  # times the change by noise alone
WINDOW_PATIENCE_S = 2.0
SLOWEST_FPS = 5.0
NS_PER_S = 1e9
UNKNOWN: Wrench = (math.nan,) * 6
LONGEST_GAP = 2.5  # times the usual time between images


class RejectedError(Exception):
    """This attempt cannot be used; the text says why. Caught within this package."""


@dataclass
class Record:
    """The result of an attempt, filled step by step, so that an aborted attempt can also be reported."""

    point: Point
    attempt: int
    tare: Tare | None = None
    rest: list[Frame] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    samples: int = 0
    start_ns: int = 0
    end_ns: int = 0
    wrench: Wrench = UNKNOWN
    deviation: Wrench = UNKNOWN
    force_rate: float = math.nan
    depth_reported_mm: float = math.nan
    reason: str = ''
    aside: bool = False
    """The force was too large: this run does not try the press again."""


@dataclass(frozen=True)
class Ground:
    """What is known before the first press: surface, safe height, zero, and image noise at rest.

    Attributes:
        surface: of the gel.
        safe_z_mm: height for sideways motion.
        zero: the tare at the start of the run.
        image_noise: largest change between two images at rest.
    """

    surface: Surface
    safe_z_mm: float
    zero: Tare
    image_noise: float


def press_cycle(record: Record, ground: Ground, settings: CollectionSettings) -> Procedure[None]:
    """Make the attempt; `record.reason` says why it cannot be used, if so.

    Raises:
        DeviceFaultError: the tip does not come free of the gel.
    """
    place = _machine_place(record.point, settings)
    yield Go(z=ground.safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    yield Go(*place, feed_mm_min=settings.motion.travel_mm_min)
    try:
        yield from _tare(record, ground, settings)
        yield from _descend(record, ground, settings)
        yield from _settle(record, ground, settings)
        yield from _window(record, ground, settings)
    except RejectedError as rejected:
        record.reason = str(rejected)
    yield Go(z=ground.safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    if record.tare is not None:
        yield from check_free(record.tare, settings)


def _tare(record: Record, ground: Ground, settings: CollectionSettings) -> Procedure[None]:
    observation = yield Look(settings.press.tare_s)
    untouched_ns = observation.since_ns
    if len(observation.samples) < 2:
        raise RejectedError('too few force samples for a tare')
    if not all(sample.usable for sample in observation.samples):
        raise RejectedError('the force/torque sensor reported a fault during the tare')
    tare = record.tare = tare_of(observation.samples)
    yield SetTare(tare)
    drift = length(np.subtract(tare.wrench[:3], ground.zero.wrench[:3]))
    if drift > settings.press.drift_n:
        raise RejectedError(f'the force without contact has changed by {drift:.2f} N since the start; is the tip free?')
    half = len(observation.samples) // 2
    first, last = tare_of(observation.samples[:half]), tare_of(observation.samples[half:])
    wander = length(np.subtract(last.wrench[:3], first.wrench[:3]))
    if wander > settings.press.unloaded_n + 2 * mean_noise(ground.zero, half):
        raise RejectedError(f'the force without contact changed by {wander:.2f} N during the tare')
    while len(observation.frames) < settings.press.rest_frames:
        if observation.now_ns - untouched_ns > settings.press.settle_s * NS_PER_S:
            raise RejectedError('no image of the untouched gel')
        observation = yield Look(LOOK_S, untouched_ns)
    record.rest = list(observation.frames[-settings.press.rest_frames :]) if settings.press.rest_frames else []


def _descend(record: Record, ground: Ground, settings: CollectionSettings) -> Procedure[None]:
    point, motion = record.point, settings.motion
    if point.depth_mm > settings.limits.depth_mm:
        raise RejectedError(f'{point.depth_mm:g} mm is deeper than the limit of {settings.limits.depth_mm:g} mm')
    standoff = ground.surface.tip_mm(point.x_mm, point.y_mm, -motion.standoff_mm)
    yield Go(z=min(ground.safe_z_mm, standoff), feed_mm_min=motion.approach_mm_min)
    assert record.tare is not None
    expect = rising(ground.surface, record.tare, settings, point.x_mm, point.y_mm)
    yield Go(z=ground.surface.tip_mm(*point[1:]), feed_mm_min=motion.press_mm_min, expect=expect)


def _settle(record: Record, ground: Ground, settings: CollectionSettings) -> Procedure[None]:
    assert record.tare is not None
    observation = yield Look(LOOK_S)
    rest_ns, steady_ns = observation.since_ns, round(settings.press.steady_s * NS_PER_S)
    deadline_ns = observation.now_ns + round(settings.press.settle_s * NS_PER_S)
    while True:
        start_ns = observation.now_ns - steady_ns
        why = 'at rest for too short a time'
        if start_ns >= rest_ns:
            samples = [sample for sample in observation.samples if sample.stamp_ns >= start_ns]
            frames = [frame for frame in observation.frames if frame.stamp_ns >= start_ns]
            why = unsteady(samples, frames, record.tare, ground.image_noise, settings)
        if not why:
            break
        if observation.now_ns > deadline_ns:
            raise RejectedError(f'not steady within {settings.press.settle_s:g} s: {why}')
        observation = yield Look(LOOK_S, start_ns)
    record.depth_reported_mm = ground.surface.depth_mm(record.point.x_mm, record.point.y_mm, observation.place_mm[2])


def unsteady(
    samples: Sequence[Sample], frames: Sequence[Frame], tare: Tare, image_noise: float, settings: CollectionSettings
) -> str:
    """Why force and image were not steady, within their noise (of the image in grey levels); empty: they were."""
    press = settings.press
    if len(samples) < FEWEST_SAMPLES:
        return 'too few force samples'
    stamps = [sample.stamp_ns for sample in samples]
    rate = slope(stamps, pressing_n(wrenches(samples), tare, settings.mounting))
    most_n_s = press.steady_n_s + STEADY_SIGMAS * slope_noise(stamps, tare.noise_n)
    if abs(rate) > most_n_s:
        return f'the force changes by {rate:.2f} N/s, more than {most_n_s:.2f} N/s'
    if len(frames) < 2:
        return 'too few images'
    moved, most_grey = change(frames[0], frames[-1]), press.steady_grey + image_noise
    return f'the image changes by {moved:.1f} grey levels, more than {most_grey:.1f}' if moved > most_grey else ''


def _window(record: Record, ground: Ground, settings: CollectionSettings) -> Procedure[None]:
    switched = (yield Switch(True)).switched
    record.start_ns = switched.latest_ns if switched is not None else 0
    try:
        samples, record.frames = yield from _gathered(record.start_ns, settings)
    except RejectedError:
        yield Switch(False)
        raise
    record.samples = len(samples)
    record.end_ns = max(samples[-1].stamp_ns, record.frames[-1].stamp_ns)
    yield Switch(False)
    _judge(record, samples, settings)
    _measure(record, samples, ground, settings)


def _gathered(start_ns: int, settings: CollectionSettings) -> Procedure[tuple[list[Sample], list[Frame]]]:
    """Measurements from `start_ns` on, until there are enough."""
    press = settings.press
    patience_ns = (WINDOW_PATIENCE_S + press.window_s + press.frames / SLOWEST_FPS) * NS_PER_S
    while True:
        observation = yield Look(LOOK_S, start_ns)
        lasted = observation.samples[-1].stamp_ns - start_ns if len(observation.samples) > 1 else 0
        if lasted >= press.window_s * NS_PER_S and len(observation.frames) >= press.frames:
            return list(observation.samples), list(observation.frames[: press.frames])
        if observation.now_ns - start_ns > patience_ns:
            raise RejectedError(
                f'too few images ({len(observation.frames)}) or force samples ({len(observation.samples)}) for the '
                'window'
            )


def _judge(record: Record, samples: Sequence[Sample], settings: CollectionSettings) -> None:
    lost = samples[-1].dropped - samples[0].dropped
    if lost:
        raise RejectedError(f'{lost} of {lost + len(samples)} force samples of the window were lost')
    if not all(sample.usable for sample in samples):
        raise RejectedError('the force/torque sensor reported a fault in the window')
    stamps = np.array([frame.stamp_ns for frame in record.frames])
    gaps = np.diff(stamps)
    if len(gaps) and gaps.max() > LONGEST_GAP * np.median(gaps):
        raise RejectedError(f'images were lost in the window: a gap of {gaps.max() / 1e6:.0f} ms')
    error = abs(record.depth_reported_mm - record.point.depth_mm)
    if error > settings.press.depth_error_mm:
        raise RejectedError(f'the reported depth differs from the commanded one by {error:.3f} mm')


def _measure(record: Record, samples: Sequence[Sample], ground: Ground, settings: CollectionSettings) -> None:
    assert record.tare is not None
    point, table = record.point, wrenches(samples)
    tip_z = ground.surface.tip_mm(*point[1:]) - ground.surface.z_mm
    gel = on_gel(table, record.tare, settings.mounting, (point.x_mm, point.y_mm, tip_z))
    force = pressing_n(table, record.tare, settings.mounting)
    record.wrench, record.deviation = as_wrench(gel.mean(axis=0)), as_wrench(gel.std(axis=0))
    record.force_rate = slope([sample.stamp_ns for sample in samples], force)
    if not float(force.mean()) > settings.press.contact_n:
        raise RejectedError(f'the force is {float(force.mean()):.3f} N at {point.depth_mm:g} mm, as without contact')
    _check_images(record, float(force.mean()), settings)


def _check_images(record: Record, force_n: float, settings: CollectionSettings) -> None:
    """Images that are late or repeated show the gel without contact."""
    least_n = settings.press.shows_n
    if not 0 < least_n <= force_n or not record.rest or len(record.frames) < 2:
        return
    noise = pattern_change(record.frames[0], record.frames[-1])
    if not pattern_change(record.rest[-1], record.frames[-1]) > SHOWN * noise:
        raise RejectedError(f'the images do not show the force of {force_n:.2f} N: are they too late?')


def _machine_place(point: Point, settings: CollectionSettings) -> tuple[float, float]:
    return settings.surface.gel_x_mm + point.x_mm, settings.surface.gel_y_mm + point.y_mm
