"""Above the untouched gel: the first zero, rest images, and waiting for a silent device."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.actions import Go, Look, Procedure, SetTare
from tactile_nodes.collection.hands import Hands, InterruptedRunError, TrippedError
from tactile_nodes.collection.readings import Frame, change
from tactile_nodes.collection.safety import MACHINE, OVERLOAD
from tactile_nodes.collection.settings import CollectionSettings, LimitSettings
from tactile_nodes.collection.wrench import Tare, length, mean_noise, tare_of
from tactile_nodes.drivers.force_torque.stream import describe_flags
from tactile_nodes.errors import DeviceFaultError, DeviceTimeoutError

ZERO_PATIENCE_S, REST_PATIENCE_S = 5.0, 10.0
"""As so many looks: the time in which this computer stands still does not count."""
MOST_NOISE_GREY = 20.0
LOOK_S = 0.05
CLEAR_MM = 1.0  # last way down to the safe height: so short that the pull of the sensor's cable stays the same


def go_to_gel(settings: CollectionSettings, safe_z_mm: float, at: tuple[float, float] = (0.0, 0.0)) -> Procedure[Tare]:
    """After homing: go above a place of the gel, down to the safe height, and read the unloaded sensor.

    Raises:
        DeviceFaultError: there are no valid samples; or the tip touches something there, and is up again.
    """
    motion, surface = settings.motion, settings.surface
    x, y = surface.gel_x_mm + at[0], surface.gel_y_mm + at[1]
    top_mm = max((yield Go()).place_mm[2], safe_z_mm)  # homing left the tip there; a machine without it may be lower
    yield Go(z=top_mm, feed_mm_min=motion.travel_mm_min)
    yield Go(x, y, feed_mm_min=motion.travel_mm_min)
    yield Go(z=min(top_mm, safe_z_mm + CLEAR_MM), feed_mm_min=motion.approach_mm_min)  # where the gel is, is not known
    above = yield from zero(settings)
    yield Go(z=safe_z_mm, feed_mm_min=motion.approach_mm_min)
    tare = yield from zero(settings)
    force = length(np.subtract(tare.wrench[:3], above.wrench[:3]))
    if force > settings.press.unloaded_n + 2 * mean_noise(above, tare.samples):
        yield Go(z=top_mm, feed_mm_min=motion.travel_mm_min)
        raise DeviceFaultError(
            f'the force changes by {force:.2f} N on the last way down to the safe height of {safe_z_mm:g} mm: the tip '
            'touches there, and sideways it would tear the gel; is it longer than before? Raise cnc.safe_z_mm, '
            'surface.top_mm and surface.bottom_mm'
        )
    return tare


def zero(settings: CollectionSettings) -> Procedure[Tare]:
    """The reading of the unloaded sensor, set as the tare. Waits for a sensor that pauses.

    Raises:
        DeviceFaultError: there are no valid samples.
    """
    observation = yield Look(settings.press.tare_s)
    for _ in range(math.ceil(ZERO_PATIENCE_S / settings.press.tare_s)):
        if len(observation.samples) >= 2:
            break
        observation = yield Look(settings.press.tare_s, observation.now_ns)
    if len(observation.samples) < 2 or not all(sample.usable for sample in observation.samples):
        raise DeviceFaultError('no valid force samples from the unloaded sensor; check it, then start again')
    tare = tare_of(observation.samples)
    yield SetTare(tare)
    return tare


def rest_frames(settings: CollectionSettings, safe_z_mm: float) -> Procedure[Sequence[Frame]]:
    """Images of the untouched gel, for a rest image.

    Raises:
        DeviceTimeoutError: there are too few.
    """
    yield Go(z=safe_z_mm, feed_mm_min=settings.motion.travel_mm_min)
    observation = yield Look(settings.press.steady_s)  # vibration of the last motion decays
    start_ns = observation.now_ns
    for _ in range(math.ceil(REST_PATIENCE_S / LOOK_S)):
        observation = yield Look(LOOK_S, start_ns)
        if len(observation.frames) >= settings.reference_frames:
            return observation.frames[: settings.reference_frames]
    raise DeviceTimeoutError(f'too few images in {REST_PATIENCE_S:g} s ({len(observation.frames)}); check the camera')


def image_noise(frames: Sequence[Frame]) -> float:
    """Largest difference of two images at rest, in grey levels.

    Raises:
        DeviceFaultError: too large for images at rest.
    """
    noise = max((change(a, b) for a, b in pairwise(frames)), default=0.0)
    if noise > MOST_NOISE_GREY:
        raise DeviceFaultError(
            f'images of the untouched gel differ by {noise:.0f} grey levels; is the light steady, the exposure fixed?'
        )
    return noise


def breath() -> Procedure[None]:
    """Wait 0.1 s without motion."""
    yield Look(0.1)


def await_recovery(hands: Hands, limits: LimitSettings, reason: str = '') -> None:
    """Return when sensor and camera have been fine for a while.

    Args:
        hands: the machine.
        limits: how long to wait.
        reason: what was wrong; empty: nothing is known yet.

    Raises:
        DeviceTimeoutError: they are not fine again within `recover_s`.
        InterruptedRunError: the run was asked to end.
        TrippedError: the machine failed too, or the force is more than is bearable.
    """
    begin_ns = well_since_ns = looked_ns = hands.clock.now_ns()
    while True:
        now_ns = hands.clock.now_ns()
        begin_ns += max(0, now_ns - looked_ns - NS_PER_S)  # this computer stood still
        looked_ns = now_ns
        if wrong := _wrong(hands, limits, now_ns):
            well_since_ns = now_ns
        if now_ns - well_since_ns >= limits.steady_again_s * NS_PER_S:
            return
        if well_since_ns - begin_ns > limits.recover_s * NS_PER_S:
            last = f' ({wrong})' if reason else ''
            raise DeviceTimeoutError(
                f'{reason or wrong}; it did not recover within {limits.recover_s:g} s{last}: check it'
            )
        hands.clock.sleep_until(now_ns + NS_PER_S // 50)


def _wrong(hands: Hands, limits: LimitSettings, now_ns: int) -> str:
    """What is wrong with recent data; empty: nothing. Resets the safety each time.

    Raises:
        TrippedError: the machine has a fault, or a person must check.
        InterruptedRunError: the run was asked to end.
    """
    if hands.asked_to_stop:
        raise InterruptedRunError
    trip = hands.safety.trip
    if trip is not None and trip.kind in {MACHINE, OVERLOAD}:
        raise TrippedError(trip)
    hands.safety.reset(now_ns, trip)
    samples = hands.readings.samples(now_ns - round(2e6 * hands.safety.silence_ms))
    frames = hands.readings.frames(now_ns - round(1e6 * limits.camera_silence_ms))
    wrong = [] if frames else ['the camera sends no images']
    if not samples:
        wrong.append('the force/torque sensor sends no samples')
    elif not samples[-1].usable:
        wrong.append(f'the force/torque sensor reports: {describe_flags(samples[-1].flags)}')
    return '; '.join(wrong) or (trip.reason if trip is not None else '')
