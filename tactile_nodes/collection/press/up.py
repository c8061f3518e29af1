"""Whether the tip is up: the machine says so, and what the force says against it counts more."""

from __future__ import annotations

from tactile_nodes.collection.actions import Look, Procedure
from tactile_nodes.collection.hands import Hands
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare, mean_change, mean_noise
from tactile_nodes.errors import DeviceFaultError

UNLOADED_S = 0.1
FREE_LOOKS = 20  # not seconds: a computer that pauses is no sensor that is silent


def check_free(tare: Tare, settings: CollectionSettings) -> Procedure[None]:
    """At the safe height nothing may touch: else sideways motion would tear the gel.

    Raises:
        DeviceFaultError: something does, or nobody can say.
    """
    seen = yield Look(UNLOADED_S)
    start_ns = seen.since_ns  # how long a sensor may pause is for the safety to say, which ends this
    for _ in range(FREE_LOOKS):
        if seen.samples:
            break
        seen = yield Look(UNLOADED_S, start_ns)
    if not seen.samples:
        raise DeviceFaultError('no force sample came above the gel, so nobody knows whether the tip is free')
    force = mean_change(seen.samples, tare)
    if not force <= settings.press.unloaded_n + mean_noise(tare, len(seen.samples)):
        raise DeviceFaultError(
            f'{force:.2f} N are left after the tip went up to the safe height; does z move, does the gel stick?'
        )


def bring_up(hands: Hands, tare: Tare | None, settings: CollectionSettings, doubted: bool = False) -> None:
    """Go up, and see whether the tip is: a board that has restarted says "idle" as well.

    Args:
        hands: the machine.
        tare: what the unloaded sensor reads; None: nobody knows yet.
        settings: what counts as no force.
        doubted: the machine was at fault, so that its word alone is not enough.

    Raises:
        DeviceError: the machine does not obey, something still touches, or nothing confirms what is in doubt.
    """
    hands.retreat()
    samples = hands.overlook(UNLOADED_S, FREE_LOOKS) if tare is not None else ()
    if tare is None or not samples:
        if doubted:
            raise DeviceFaultError(
                'nobody knows whether the tip is up: the machine was at fault, and no force says that nothing touches; '
                'look at it'
            )
        return
    force = mean_change(samples, tare)
    if not force <= settings.press.unloaded_n + mean_noise(tare, len(samples)):
        raise DeviceFaultError(
            f'{force:.2f} N are left although the machine says that the tip is up; look at it before anything moves'
        )
