"""Why a force is not to be trusted, in sentences for whoever stands beside the sensor."""

from __future__ import annotations

from tactile_nodes.messages import types
from tactile_nodes.viewing.state import reason_names

_KIND = types.ForceDistribution
_SENTENCES = {
    _KIND.REASON_NO_REFERENCE: 'There is no rest image yet.',
    _KIND.REASON_DARK_IMAGE: 'The image holds no light: is the lamp on, the lens free?',
    _KIND.REASON_SATURATED_IMAGE: 'The image is burnt out: shorten the exposure.',
    _KIND.REASON_LOW_CONFIDENCE: 'Too few regions could be tracked.',
    _KIND.REASON_FOREIGN_MOTION: 'The whole picture moved: was the camera knocked?',
    _KIND.REASON_NOT_FINITE: 'The model answered with a number that is none.',
    _KIND.REASON_STALE: 'The frame is older than it should be.',
    _KIND.REASON_OTHER_IMAGE: 'The image has another size than the model was trained on.',
    _KIND.REASON_UNLIKE_TRAINING: 'The motion is unlike any that the model was trained on.',
    _KIND.REASON_CALIBRATION_AGEING: 'The calibration holds less well than it did.',
    _KIND.REASON_CALIBRATION_INVALID: 'The calibration holds no longer.',
    _KIND.REASON_PICTURE_LOST: 'The gel is not found in the picture: did the camera or the gel move far?',
    _KIND.REASON_LIGHT_CHANGED: 'The light changed too much: mend the lamp, or capture the rest image again.',
    _KIND.REASON_BLURRED: 'The picture is less sharp than it was: look at lens and focus.',
    _KIND.REASON_REST_DOUBTFUL: 'Something touched while the rest image was taken: capture it again.',
    _KIND.REASON_BEGINNING: 'Contact began in this frame, which may have caught it moving.',
    _KIND.REASON_UNCALIBRATED: 'No force was ever compared with this model: calibrate it with a few known ones.',
}


def sentences(reasons: int) -> list[str]:
    """One for each bit of ForceDistribution.reasons; a bit without a sentence of its own is named.

    >>> sentences(types.ForceDistribution.REASON_STALE)
    ['The frame is older than it should be.']
    """
    told = [text for bit, text in _SENTENCES.items() if reasons & bit]
    rest = reasons & ~sum(_SENTENCES)
    return told + [f'{name.capitalize()}.' for name in reason_names(rest)]
