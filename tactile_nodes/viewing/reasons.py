"""Why a force should not be trusted, as sentences for the user."""

from __future__ import annotations

from tactile_nodes.messages import types
from tactile_nodes.viewing.state import reason_names

_KIND = types.ForceDistribution
_SENTENCES = {
    _KIND.REASON_NO_REFERENCE: 'There is no rest image yet.',
    _KIND.REASON_DARK_IMAGE: 'The image is dark. Is the lamp on and the lens uncovered?',
    _KIND.REASON_SATURATED_IMAGE: 'The image is overexposed. Shorten the exposure.',
    _KIND.REASON_LOW_CONFIDENCE: 'Too few regions could be tracked.',
    _KIND.REASON_FOREIGN_MOTION: 'The whole picture moved. Was the camera knocked?',
    _KIND.REASON_NOT_FINITE: 'The result of the model is not finite.',
    _KIND.REASON_STALE: 'The frame is older than it should be.',
    _KIND.REASON_OTHER_IMAGE: 'The image size differs from that of the training.',
    _KIND.REASON_UNLIKE_TRAINING: 'The motion is unlike the training data.',
    _KIND.REASON_CALIBRATION_AGEING: 'The calibration has become less accurate.',
    _KIND.REASON_CALIBRATION_INVALID: 'The calibration is no longer valid.',
    _KIND.REASON_PICTURE_LOST: 'The gel was not found in the picture. Did the camera or the gel move far?',
    _KIND.REASON_LIGHT_CHANGED: 'The picture differs from the rest image. Check the light, or capture it again.',
    _KIND.REASON_BLURRED: 'The picture is less sharp than before. Check lens and focus.',
    _KIND.REASON_REST_DOUBTFUL: 'Something touched the gel while the rest image was taken. Capture it again.',
    _KIND.REASON_BEGINNING: 'Contact began in this frame, so the gel may still be moving.',
    _KIND.REASON_UNCALIBRATED: 'The model was never compared with a known force. Calibrate it with a few known forces.',
}


def sentences(reasons: int) -> list[str]:
    """A sentence for each bit of ForceDistribution.reasons; a bit without its own sentence is named.

    >>> sentences(types.ForceDistribution.REASON_STALE)
    ['The frame is older than it should be.']
    """
    texts = [text for bit, text in _SENTENCES.items() if reasons & bit]
    rest = reasons & ~sum(_SENTENCES)
    return texts + [f'{name.capitalize()}.' for name in reason_names(rest)]
