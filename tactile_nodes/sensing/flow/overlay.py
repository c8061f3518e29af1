"""Draws motion over its image."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tactile_nodes.shapes import Float32, UInt8

SPACING_PX, LEAST_PX, GAIN = 11, 0.25, 4.0


def overlay(
    image: UInt8[np.ndarray, 'h w'], field_px: Float32[np.ndarray, 'rows cols 2']
) -> UInt8[np.ndarray, 'h w 3']:
    """The image (BGR) with an arrow at each motion of `LEAST_PX` or more, `GAIN` times as long as the motion."""
    if field_px.shape[:2] != image.shape:
        field_px = cv2.resize(field_px, image.shape[::-1], interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    half = SPACING_PX // 2
    for y in range(half, image.shape[0], SPACING_PX):
        for x in range(half, image.shape[1], SPACING_PX):
            dx, dy = (float(part) for part in field_px[y, x])
            if math.hypot(dx, dy) >= LEAST_PX:
                tip = (round(x + GAIN * dx), round(y + GAIN * dy))
                cv2.arrowedLine(picture, (x, y), tip, (0, 200, 255), 1, cv2.LINE_AA, tipLength=0.3)
    return picture
