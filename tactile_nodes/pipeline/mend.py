"""The first stage: repairs dead pixels, and checks whether anything can be measured in the image."""

from __future__ import annotations

from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels
from tactile_nodes.sensing.picture.quality import picture_faults
from tactile_nodes.sensing.rest.in_use import RestInUse

FORCE = types.ForceDistribution


def mend(dead: DeadPixels, rest: RestInUse | None, frame: Frame, *, compiled: bool) -> None:
    """Fill in dead pixels, and check the image: it may be dark, overexposed, or of another size than `rest`.

    The dead pixels come from the rest image. Without one, images stay as they are.
    """
    if rest is not None:
        frame.image = dead.mended(frame.image)
    faults = picture_faults(frame.image, compiled=compiled)
    frame.level = faults.level
    if faults.dark:
        frame.reasons |= FORCE.REASON_DARK_IMAGE
    if faults.saturated:
        frame.reasons |= FORCE.REASON_SATURATED_IMAGE
    if rest is None:
        frame.reasons |= FORCE.REASON_NO_REFERENCE
    elif frame.image.shape != rest.prepared.image.shape:
        frame.reasons |= FORCE.REASON_OTHER_IMAGE
    elif rest.captured.faint(faults.level):
        frame.reasons |= FORCE.REASON_DARK_IMAGE
