"""Checks the printed dots of a picture against the description: number, rows and columns, and position."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tactile_nodes.sensing.elasticity.rays import dot_place_mm
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensing.flow.dot_pattern import Dots
from tactile_nodes.sensing.inspection.findings import BAD, LOOK, OK, Finding, tone
from tactile_nodes.shapes import Float

PITCH_OFF, TURNED_DEG, DOTS_FOUND, MORE = 0.05, 3.0, 0.8, 1.8
"""Allowed relative error of the pitch; allowed rotation of the rows; least ratio of found to described dots, and of
described to found ones; ratio of found to described dots above which the finding is bad."""

ASIDE = 0.1
"""Allowed offset of the dots from the described positions, over the pitch."""

ASKEW_DEG, UNLIKE, BETWEEN, HALF = 15.0, 0.2, 0.5, 0.15
"""Limits for a grid with right angles and one pitch: deviation of the columns from a right angle to the rows, relative
difference of the two pitches, share of the dots with another dot in the middle of four, and how close to half a step
each row may be shifted against the one before it."""

NEAR = 0.2
"""How far a dot may be from the middle of four others, over the pitch."""

STAGGERED = 'they are staggered or in diagonal rows'
PITCH_HELP = 'check pattern.pitch_mm, camera.position_mm and its focal length'
FEW_HELP = 'check light and focus; if a part has no dots, mask it, or forces are reported at the wrong places'
NO_GRID = (
    '; a description supports rows and columns at right angles only, with equal distances, and nearly parallel to '
    'the sides of the image'
)


def dot_findings(view: View, dots: Dots | None, wanted: int) -> Sequence[Finding]:
    """Findings about the dots, of which `wanted` are described within the picture."""
    pattern = view.sensor.pattern
    if dots is None:
        text = (
            f'no dots in rows and columns; {wanted} are described: check light and focus, or set pattern.kind to '
            'spheres'
        )
        return (Finding('dots', BAD, text),)
    if dots.dark != pattern.dark:
        text = f'dots are {tone(dots.dark)}, but the description says {tone(pattern.dark)}: set pattern.dark'
        return (Finding('dots', BAD, text),)
    found = f'{len(dots)} {tone(pattern.dark)} dots found, {wanted} described within the image'
    if fault := _no_grid(view, dots):
        return (Finding('dots', BAD, f'{found}: {fault}{NO_GRID}'),)
    return _count(found, len(dots), wanted), _pitch(view, dots), _place(view, dots)


def not_random(view: View, dots: Dots) -> Finding:
    """What is wrong with dots whose description says `spheres`."""
    fault = _no_grid(view, dots)
    meaning = (
        f': {fault}{NO_GRID}' if fault else ' in rows and columns, but the description says spheres: set pattern.kind'
    )
    return Finding('pattern', BAD, f'{len(dots)} dots{meaning}')


def _count(found: str, count: int, wanted: int) -> Finding:
    if DOTS_FOUND * count > wanted:
        level = BAD if MORE * wanted < count else LOOK
        return Finding('dots', level, f'{found}: check pattern.pitch_mm and the size of the gel')
    if count < DOTS_FOUND * wanted:
        return Finding('dots', LOOK, f'{found}: {FEW_HELP}')
    return Finding('dots', OK, found)


def _no_grid(view: View, dots: Dots) -> str:
    """Why the dots do not form a grid with right angles and one pitch; empty if they do."""
    if (between := _between(dots)) > BETWEEN:
        return f'{100 * between:.0f} % of them lie in the middle of four others: {STAGGERED}'
    (x, y), (u, v) = _steps_mm(view, dots)
    across, down, both = math.hypot(x, y), math.hypot(u, v), x * u + y * v
    if any(abs(abs(both) / step**2 - 0.5) < HALF for step in (across, down)):
        return f'each row is shifted by half a step against the one before it: {STAGGERED}'
    if not 1 / (1 + UNLIKE) < across / down < 1 + UNLIKE:
        return f'they are {across:.2f} mm apart along rows and {down:.2f} mm along columns'
    askew = math.degrees(math.asin(both / (across * down)))
    if abs(askew) > ASKEW_DEG:
        return f'their columns are {abs(askew):.0f} degrees off a right angle to their rows'
    return ''


def _between(dots: Dots) -> float:
    """Among dots with a neighbour in the next row and the next column, the share with a dot in the middle of these."""
    centres, near = dots.centres_px, NEAR * dots.pitch_px

    def there(step: Float[np.ndarray, ' 2']) -> Float[np.ndarray, ' dots']:
        away = centres[None] - (centres + step)[:, None]
        return np.asarray(np.hypot(away[..., 0], away[..., 1]).min(axis=1))

    whole = (there(dots.across_px) < near) & (there(dots.down_px) < near)
    middle = there((dots.across_px + dots.down_px) / 2) < near
    return float(middle[whole].mean()) if whole.any() else 0.0


def _steps_mm(view: View, dots: Dots) -> Float[np.ndarray, '2 2']:
    """The vectors from a dot to the next in its row and in its column, on the gel in the middle of the picture."""
    middle = (np.array(view.sensor.image.crop_px)[None] - 1) / 2
    px_per_mm = view.moves_at(view.met_at(middle, view.middle_mm))[0, :, :2]
    return np.asarray(np.linalg.solve(px_per_mm, np.column_stack([dots.across_px, dots.down_px])).T)


def _pitch(view: View, dots: Dots) -> Finding:
    described_px = view.px_per_mm * view.sensor.pattern.pitch_mm
    # Rows and columns are alike: a grid that is turned by 90 degrees is the same.
    turned = (dots.turn_deg + view.sensor.camera.roll_deg + 45) % 90 - 45
    off = dots.pitch_px / described_px - 1
    text = f'{dots.pitch_px:.1f} px apart, {described_px:.1f} described, rows turned by {turned:.1f} degrees'
    if abs(off) > PITCH_OFF:
        text += f': {PITCH_HELP}'
    return Finding('pitch', LOOK if abs(off) > PITCH_OFF or abs(turned) > TURNED_DEG else OK, text)


def _place(view: View, dots: Dots) -> Finding:
    """Whether the dots are at the described positions."""
    pattern = view.sensor.pattern
    x, y = dot_place_mm(view, dots.centres_px)
    aside = np.array([x, y]) - pattern.dot_mm
    away = float(np.hypot(*(aside - pattern.pitch_mm * np.rint(aside / pattern.pitch_mm))))
    text = f'dots are {away:.1f} mm off the described positions'
    if away <= ASIDE * pattern.pitch_mm:
        return Finding('place', OK, text)
    text += f', so forces are reported at the wrong places: set pattern.dot_mm to [{x:.1f}, {y:.1f}]'
    return Finding('place', LOOK, text)
