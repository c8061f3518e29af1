"""Show the next press: in the camera's image, and as a sketch of the gel in text characters."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tactile_nodes.learning.guided.targets import Target
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import UInt8

MARK, DONE = (0, 0, 255), (0, 200, 0)
"""Blue, green, red: the next place is red, finished presses are green."""
COLUMNS = 41


def marked(
    picture: UInt8[np.ndarray, 'h w'], sensor: Sensor, target: Target, done: Sequence[Target]
) -> UInt8[np.ndarray, 'h w 3']:
    """The image with a cross at the next place, and a dot for each finished press."""
    image = sensor.image
    places = np.array([target[:2], *(each[:2] for each in done if np.isfinite(each[:2]).all())])
    corner = (np.array([image.width, image.height]) - image.crop_px) // 2
    pixels = np.rint(corner + View(sensor).middle_seen_at(places)).astype(int)
    drawn = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    for place in pixels[1:].tolist():
        cv2.circle(drawn, place, 4, DONE, cv2.FILLED)
    middle = pixels[0].tolist()
    cv2.drawMarker(drawn, middle, MARK, cv2.MARKER_CROSS, 30, 2)
    cv2.circle(drawn, middle, 15, MARK, 2)
    return drawn


def sketch(sides_mm: tuple[float, float], target: Target, done: Sequence[Target]) -> list[str]:
    """The gel as in the image, y down: X next, o pressed, + centre; a character is twice as high as wide."""
    width, height = sides_mm
    rows = max(3, round(COLUMNS * height / width / 2) | 1)
    cells = [['.'] * COLUMNS for _ in range(rows)]

    def put(x_mm: float, y_mm: float, sign: str) -> None:
        col, row = round((x_mm / width + 0.5) * (COLUMNS - 1)), round((y_mm / height + 0.5) * (rows - 1))
        cells[min(max(row, 0), rows - 1)][min(max(col, 0), COLUMNS - 1)] = sign

    put(0.0, 0.0, '+')
    for each in done:
        if np.isfinite(each[:2]).all():
            put(each.x_mm, each.y_mm, 'o')
    put(target.x_mm, target.y_mm, 'X')
    return [''.join(row) for row in cells]
