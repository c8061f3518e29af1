"""Draws the result of an inspection over the sensor's picture."""

from __future__ import annotations

import textwrap

import cv2
import numpy as np

from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK
from tactile_nodes.sensing.inspection.judging import Inspection, outline_px
from tactile_nodes.shapes import Bool, Float, UInt8

Canvas = UInt8[np.ndarray, 'high wide 3']
Colour = tuple[int, int, int]

WIDTH_PX, LINE_PX, CHARACTERS = 960, 22, 100
GREEN, AMBER, RED, CYAN, WHITE, GREY = (
    (90, 200, 80), (40, 170, 255), (60, 60, 235), (230, 200, 60), (255, 255, 255), (120, 120, 120),
)  # fmt: skip
"""Blue, green, red."""

TAGS = {OK: ('ok', GREEN), LOOK: ('LOOK', AMBER), BAD: ('BAD', RED)}
LEGEND = (
    'white: gel   green/amber: regions with/without pattern   cyan: dots found (+ described)   red: looks covered   '
    'blue: mask'
)


def figure(inspection: Inspection) -> Canvas:
    """The picture with the gel's outline, regions, dots and covered parts, and the findings below it."""
    height, width = inspection.rest.shape
    scale = max(1, round(WIDTH_PX / width))
    size = width * scale, height * scale
    canvas = cv2.cvtColor(cv2.resize(inspection.rest, size, interpolation=cv2.INTER_LINEAR), cv2.COLOR_GRAY2BGR)
    _tint(canvas, inspection.sensor.covered, (200, 90, 30))
    _tint(canvas, inspection.unmasked, RED)
    _regions(canvas, inspection)
    _dots(canvas, inspection, scale)
    outline = np.rint((outline_px(inspection.regions) + 0.5) * scale * 8).astype(np.int32)
    cv2.polylines(canvas, [outline], True, WHITE, 2, cv2.LINE_AA, 3)
    return np.vstack([canvas, _words(inspection, canvas.shape[1])])


def _tint(canvas: Canvas, on: Bool[np.ndarray, 'h w'], colour: Colour) -> None:
    over = cv2.resize(on.astype(np.uint8), canvas.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    canvas[over] = (0.5 * canvas[over] + 0.5 * np.array(colour)).astype(np.uint8)


def _regions(canvas: Canvas, inspection: Inspection) -> None:
    """Draw a small square in the middle of each usable region."""
    regions, (height, width) = inspection.regions, canvas.shape[:2]
    half = max(2, round(min(width / regions.cols, height / regions.rows) / 12))
    for number in np.flatnonzero(regions.usable).tolist():
        row, col = divmod(number, regions.cols)
        x, y = round((col + 0.5) * width / regions.cols), round((row + 0.5) * height / regions.rows)
        colour = GREEN if inspection.marked[number] else AMBER
        cv2.rectangle(canvas, (x - half, y - half), (x + half, y + half), colour, -1)


def _dots(canvas: Canvas, inspection: Inspection, scale: int) -> None:
    dots = inspection.dots
    if dots is not None:
        for x, y in _at(dots.centres_px, scale):
            cv2.circle(canvas, (x, y), round(dots.diameter_px * scale / 2), CYAN, 2, cv2.LINE_AA)
    if inspection.sensor.pattern.kind == 'dots':
        for x, y in _at(inspection.expected_dots, scale):
            cv2.drawMarker(canvas, (x, y), CYAN, cv2.MARKER_CROSS, 12, 2)


def _at(places: Float[np.ndarray, 'places 2'], scale: int) -> list[list[int]]:
    placed: list[list[int]] = np.rint((places + 0.5) * scale).astype(int).tolist()
    return placed


def _words(inspection: Inspection, width: int) -> Canvas:
    """The findings and the legend, on black."""
    lines = [('', GREY, LEGEND)]
    for each in inspection.findings:
        tag, colour = TAGS[each.level]
        first, *rest = textwrap.wrap(f'{each.subject}: {each.text}', max(20, round(CHARACTERS * width / WIDTH_PX)))
        lines += [(tag, colour, first), *(('', colour, line) for line in rest)]
    below = np.zeros((LINE_PX * (len(lines) + 1), width, 3), np.uint8)
    for number, (tag, colour, text) in enumerate(lines):
        y = LINE_PX * (number + 1)
        cv2.putText(below, tag, (10, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
        cv2.putText(below, text, (70, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, WHITE, 1, cv2.LINE_AA)
    return below
