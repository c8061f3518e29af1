"""Whether the tip is up: according to the machine, and, with more weight, according to the force."""

from __future__ import annotations

from tactile_nodes.collection.actions import Look, Procedure
from tactile_nodes.collection.hands import Hands
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare, mean_change, mean_noise
from tactile_nodes.errors import DeviceError, DeviceFaultError

UNLOADED_S = 0.1
FREE_LOOKS = 20  # not seconds: a computer that pauses is not a silent sensor


def check_free(tare: Tare, settings: CollectionSettings) -> Procedure[None]:
    """At the safe height there must be no contact, or sideways motion would tear the gel.

    Raises:
        DeviceFaultError: there is contact, or it is unknown.
    """
    observation = yield Look(UNLOADED_S)
    start_ns = observation.since_ns  # the safety decides how long a sensor may pause, and ends this
    for _ in range(FREE_LOOKS):
        if observation.samples:
            break
        observation = yield Look(UNLOADED_S, start_ns)
    if not observation.samples:
        raise DeviceFaultError('no force samples above the gel, so it is unknown whether the tip is free')
    force = mean_change(observation.samples, tare)
    if not force <= settings.press.unloaded_n + mean_noise(tare, len(observation.samples)):
        raise DeviceFaultError(
            f'{force:.2f} N remain after the tip went up to the safe height; does z move, does the gel stick?'
        )


def not_up(error: DeviceError) -> str:
    """What a person must know when `bring_up` has failed. Closing the machine also dismisses its dead man's switch."""
    return (
        f'the tip may not be up: {error}; nothing lifts it when this program has ended, so see where it is '
        'before anything moves'
    )


def bring_up(hands: Hands, tare: Tare | None, settings: CollectionSettings, doubted: bool = False) -> None:
    """Go up, and check that the tip is up: a controller that has restarted reports "idle" as well.

    Args:
        hands: the machine.
        tare: reading of the unloaded sensor; None: not known yet.
        settings: the threshold for no force.
        doubted: the machine was at fault, so that its report alone is not enough.

    Raises:
        DeviceError: the machine does not obey, there is still contact, or nothing confirms a doubted report.
    """
    hands.retreat()
    samples = hands.overlook(UNLOADED_S, FREE_LOOKS) if tare is not None else ()
    if tare is None or not samples:
        if doubted:
            raise DeviceFaultError(
                'it is unknown whether the tip is up: the machine was at fault, and no force sample shows it free; '
                'check it'
            )
        return
    force = mean_change(samples, tare)
    if not force <= settings.press.unloaded_n + mean_noise(tare, len(samples)):
        raise DeviceFaultError(
            f'{force:.2f} N remain although the machine reports the tip up; check it before anything moves'
        )
