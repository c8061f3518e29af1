"""Motion drawn over the picture that it was found in."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32, UInt8


def overlay(
    image: UInt8[np.ndarray, 'h w'],
    field_px: Float32[np.ndarray, 'rows cols 2'],
    *,
    spacing_px: int = 11,
    gain: float = 4.0,
    least_px: float = 0.25,
) -> UInt8[np.ndarray, 'h w 3']:
    """The image with an arrow wherever it moved by `least_px` or more, `gain` times as long as the motion (BGR)."""
    if field_px.shape[:2] != image.shape:
        field_px = cv2.resize(field_px, image.shape[::-1], interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    half = spacing_px // 2
    for y in range(half, image.shape[0], spacing_px):
        for x in range(half, image.shape[1], spacing_px):
            dx, dy = (float(part) for part in field_px[y, x])
            if dx * dx + dy * dy >= least_px * least_px:
                tip = (round(x + gain * dx), round(y + gain * dy))
                cv2.arrowedLine(picture, (x, y), tip, (0, 200, 255), 1, cv2.LINE_AA, tipLength=0.3)
    return picture
