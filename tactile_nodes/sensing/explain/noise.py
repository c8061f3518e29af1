"""Noise of a frame's motion, estimated from differences between neighbouring regions."""

from __future__ import annotations

import cv2
import numpy as np

from tactile_nodes.shapes import Bool, Float32

QUIETEST, SIGMAS = 0.3, 0.3853
"""The quieter three tenths of the regions give the noise of a frame: of normal noise this share lies within this many
standard deviations."""

CURVED, CURVED_TIMES = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32), 6.0
"""Filter that removes smooth motion from nine regions (Immerkær 1996); its output is six times the noise of each."""

FOUND_NOISE = 0.85
"""Share of the median region's noise that this estimate finds, since regions differ."""

LEAST_DIFFERENCES = 20


def noise_of(moved: Float32[np.ndarray, 'rows cols 2'], inside: Bool[np.ndarray, 'rows cols']) -> float:
    """The noise of a frame's motion [px], from differences between neighbours away from contacts.

    `inside` are regions that are known with all their neighbours. Returns 0 if there are too few.
    """
    left = np.abs(cv2.filter2D(moved, -1, CURVED)[inside]).ravel()
    if left.size < LEAST_DIFFERENCES:
        return 0.0
    place = int(QUIETEST * left.size)
    return float(np.partition(left, place)[place]) / (SIGMAS * CURVED_TIMES)


def inside_of(known: Bool[np.ndarray, 'rows cols']) -> Bool[np.ndarray, 'rows cols']:
    """Regions that are known with all eight neighbours."""
    eroded: np.ndarray = cv2.erode(
        known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return eroded > 0
