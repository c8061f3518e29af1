"""Above the untouched gel: the first zero, rest images, and waiting for a device that has fallen silent."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.actions import Go, Look, Procedure, SetTare
from tactile_nodes.collection.hands import Hands, InterruptedRunError, TrippedError
from tactile_nodes.collection.readings import Frame, change
from tactile_nodes.collection.safety import MACHINE
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings
from tactile_nodes.collection.wrench import Tare, tare_of
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

ZERO_PATIENCE_S = 5.0
REST_PATIENCE_S = 10.0
MOST_NOISE_GREY = 20.0
LOOK_S = 0.05


def go_to_gel(settings: CollectionSettings, safe_z_mm: float) -> Procedure[Tare]:
    """After homing: to above the middle of the gel, and what the unloaded sensor reads there.

    Raises:
        DeviceFaultError: no sound samples come.
    """
    feed = settings.motion.travel_mm_min
    yield Go(settings.surface.gel_x_mm, settings.surface.gel_y_mm, feed_mm_min=feed)  # homing left the tip at the top
    yield Go(z=safe_z_mm, feed_mm_min=settings.motion.approach_mm_min)  # where the gel begins, nobody knows yet
    return (yield from zero(settings))


def zero(settings: CollectionSettings) -> Procedure[Tare]:
    """What the unloaded sensor reads, set as the tare. A sensor that pauses is waited for.

    Raises:
        DeviceFaultError: no sound samples come.
    """
    seen = yield Look(settings.press.tare_s)
    start_ns = seen.since_ns
    while len(seen.samples) < 2 and seen.now_ns - start_ns < ZERO_PATIENCE_S * NS_PER_S:
        seen = yield Look(settings.press.tare_s, seen.now_ns)
    if len(seen.samples) < 2 or not all(sample.usable for sample in seen.samples):
        raise DeviceFaultError('no sound force samples come from the unloaded sensor; check it, then start again')
    tare = tare_of(seen.samples)
    yield SetTare(tare)
    return tare


def rest_frames(settings: CollectionSettings, safe_z_mm: float) -> Procedure[Sequence[Frame]]:
    """Images of the untouched gel, for a rest image.

    Raises:
        DeviceTimeoutError: too few come.
    """
    yield Go(z=safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    seen = yield Look(settings.press.steady_s)  # what the last motion shook comes to rest
    start_ns = seen.now_ns
    while True:
        seen = yield Look(LOOK_S, start_ns)
        if len(seen.frames) >= settings.reference_frames:
            return seen.frames[: settings.reference_frames]
        if seen.now_ns - start_ns > REST_PATIENCE_S * NS_PER_S:
            raise DeviceTimeoutError(f'{len(seen.frames)} images came in {REST_PATIENCE_S:g} s; look at the camera')


def image_noise(frames: Sequence[Frame]) -> float:
    """How much two images at rest differ at most, in grey levels.

    Raises:
        DeviceFaultError: too much for images at rest.
    """
    noise = max((change(a, b) for a, b in pairwise(frames)), default=0.0)
    if noise > MOST_NOISE_GREY:
        raise DeviceFaultError(
            f'images of the untouched gel differ by {noise:.0f} grey levels; is the light steady, the exposure fixed?'
        )
    return noise


def breath() -> Procedure[None]:
    """Let a tenth of a second pass, with the tip where it is."""
    yield Look(0.1)


def await_recovery(hands: Hands, limits: LimitSettings, reason: str) -> None:
    """Return when sensor and camera have been well for a while.

    Raises:
        DeviceTimeoutError: they are not well again within `recover_s`.
        InterruptedRunError: the run is to end.
        TrippedError: the machine failed, too.
    """
    begin_ns = hands.clock.now_ns()
    well_since_ns = begin_ns
    while True:
        now_ns = hands.clock.now_ns()
        if not _is_well(hands, limits, now_ns):
            well_since_ns = now_ns
        if now_ns - well_since_ns >= limits.steady_again_s * NS_PER_S:
            return
        if well_since_ns - begin_ns > limits.recover_s * NS_PER_S:
            raise DeviceTimeoutError(f'{reason}; it was not well again within {limits.recover_s:g} s: look at it')
        hands.clock.sleep_until(now_ns + NS_PER_S // 50)


def _is_well(hands: Hands, limits: LimitSettings, now_ns: int) -> bool:
    """Judged by what came in lately; the safety begins anew each time, and only a fault of the machine counts."""
    if hands.asked_to_stop:
        raise InterruptedRunError
    trip = hands.safety.trip
    if trip is not None and trip.kind == MACHINE:
        raise TrippedError(trip)
    hands.safety.reset(now_ns)
    samples = hands.readings.samples(now_ns - round(2e6 * hands.safety.silence_ms))
    frames = hands.readings.frames(now_ns - round(1e6 * limits.camera_silence_ms))
    return trip is None and bool(frames) and bool(samples) and samples[-1].usable
