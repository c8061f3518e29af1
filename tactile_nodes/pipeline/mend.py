"""First: the picture as it should be, and whether anything can be measured in it at all."""

from __future__ import annotations

from tactile_nodes.messages import types
from tactile_nodes.pipeline.frame import Frame
from tactile_nodes.sensing.picture.dead_pixels import DeadPixels
from tactile_nodes.sensing.picture.quality import picture_faults
from tactile_nodes.sensing.rest.in_use import RestInUse

FORCE = types.ForceDistribution


def mend(dead: DeadPixels, rest: RestInUse | None, frame: Frame, *, compiled: bool) -> None:
    """Fill in dead pixels, and look at what is left: it may be dark, burnt out, or of another size than `rest`.

    Without a rest image, which knows its dead pixels, pictures stay as they came.
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
