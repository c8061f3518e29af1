"""Whether the mounting of the camera gave way under the forces of presses, and how far."""

from __future__ import annotations

import numpy as np

from tactile_nodes.sensing.explain.camera import without_camera
from tactile_nodes.shapes import Float

HELD = 0.9
"""Share of the residual (root mean square) that the motion of the camera leaves at least, if the mounting holds. A
simulated mounting that gives way by 0.001 mm per newton is recognized by it, and one that holds passes under a tip
(`PYTHONPATH=. python test/learning/imported/study.py force 0 0.001`)."""

MOST = 90
"""Percentile of the presses that is stated. Hard ones may show less, since motion above 0.05 px is a knock and was
removed from the image."""


def gives_way_px(
    camera: Float[np.ndarray, 'terms motions'],
    left: Float[np.ndarray, 'n regions 2'],
    certainty: Float[np.ndarray, 'n regions 2'],
    force_n: Float[np.ndarray, ' n'],
) -> float:
    """How far the picture moves per newton at least (px/N); 0 if the residuals of presses do not show it.

    `camera` is as in `camera_terms`, `certainty` the inverse variance of the residuals `left`.
    """
    still = without_camera(camera, left, certainty)
    seen = int((certainty > 0).sum())
    before, after = ((np.square(each) * certainty).sum() for each in (left, still))
    pressed = force_n > 0
    if not pressed.any() or after / max(seen - len(left) * len(camera), 1) > HELD**2 * before / max(seen, 1):
        return 0.0
    moved = np.sqrt(np.square(left - still).sum(axis=-1).mean(axis=-1))
    return float(np.percentile(moved[pressed] / force_n[pressed], MOST))


def in_words(gives_px: float, other: str) -> str:
    """What to do about it, in a sentence; empty if the picture holds. `other` is the other cause that it may have."""
    if not gives_px:
        return ''
    return (
        f'the picture moves by at least {gives_px:.2g} px per newton: the mounting of the camera gives way under the '
        f'force, or {other}. The motion was removed; if it is the mounting, a stiffer one makes forces more certain'
    )
