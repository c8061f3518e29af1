"""Whether all that a run will press is within its limits: the workspace of the machine, the depth, the force."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_nodes.collection.plan.plan import Point
from tactile_nodes.collection.press.surface import Surface, corners
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.drivers.cnc.contract import Envelope
from tactile_nodes.drivers.cnc.envelope import AXES, TOLERANCE_MM
from tactile_nodes.errors import ConfigurationError

NAMED = 5


def check_depths(points: Sequence[Point], settings: CollectionSettings) -> None:
    """Refuse presses deeper than `limits.depth_mm`.

    Raises:
        ConfigurationError: names them.
    """
    most_mm = settings.limits.depth_mm
    if deep := [point for point in points if point.depth_mm > most_mm]:
        raise ConfigurationError(
            f'the plan presses too deep, limits.depth_mm allows {most_mm:g} mm; change one of them: {named(deep)}'
        )


def check_workspace(
    points: Sequence[Point], settings: CollectionSettings, box: Envelope, surface: Surface | None = None
) -> None:
    """Refuse presses outside the workspace, and a surface search outside of it.

    Args:
        points: of the plan.
        settings: places of the gel, the corners and the anchor.
        box: the workspace.
        surface: as found; None: not known yet, so only a press that is too low from `surface.top_mm` is refused.

    Raises:
        ConfigurationError: names them.
    """
    if beyond := [point for point in points if _is_beyond(point, settings, box, surface)]:
        where = settings.surface
        raise ConfigurationError(
            f'the plan presses outside the workspace of the machine ({_ranges(box)}); change the plan, or the centre '
            f'of the gel, surface.gel_x_mm {where.gel_x_mm:g} and surface.gel_y_mm {where.gel_y_mm:g}: {named(beyond)}'
        )
    if settings.surface.bottom_mm < box.lowest_mm[2] - TOLERANCE_MM or any(
        _is_beyond(point, settings, box, surface) for point in _others(settings)
    ):
        raise ConfigurationError(
            f'a corner of the surface search (surface.reach_mm, surface.bottom_mm) or the anchor lies outside the '
            f'workspace of the machine ({_ranges(box)}); change it, or surface.gel_x_mm and surface.gel_y_mm'
        )


def check_approach(x_mm: float, y_mm: float, travel_mm: float, settings: CollectionSettings, box: Envelope) -> None:
    """Refuse a way down from `surface.top_mm` that leaves the workspace.

    Raises:
        ConfigurationError: names it.
    """
    if _is_beyond(Point(1, x_mm, y_mm, travel_mm), settings, box, None):
        raise ConfigurationError(
            f'the approach at x_mm {x_mm:g} and y_mm {y_mm:g}, {travel_mm:g} mm down from surface.top_mm, leaves the '
            f'workspace of the machine ({_ranges(box)}); change them, guard.travel_mm, or surface.gel_x_mm and gel_y_mm'
        )


def forceful(points: Sequence[Point], settings: CollectionSettings, surface: Surface) -> Sequence[Point]:
    """Presses that exceed `limits.force_n` even where the gel is as soft as at its softest corner."""
    return [point for point in points if surface.force_n(point.depth_mm) > settings.limits.force_n]


def named(points: Sequence[Point]) -> str:
    """'press 2 at x -4, y -2 mm, 1.5 mm deep, and 3 more'"""
    first = [f'press {p.press} at x {p.x_mm:g}, y {p.y_mm:g} mm, {p.depth_mm:g} mm deep' for p in points[:NAMED]]
    return ', '.join([*first, f'and {len(points) - NAMED} more'] if len(points) > NAMED else first)


def _others(settings: CollectionSettings) -> list[Point]:
    """What is pressed besides the plan; a corner only as deep as its surface, whose search has a limit of its own."""
    found = [Point(0, *at, 0.0) for at in corners(settings)]
    anchor = settings.anchor
    if anchor.every:
        ways = ((0.0, 0.0), (anchor.step_mm, 0.0), (0.0, anchor.step_mm))
        found += [Point(0, anchor.x_mm + x, anchor.y_mm + y, anchor.depth_mm) for x, y in ways]
    return found


def _is_beyond(point: Point, settings: CollectionSettings, box: Envelope, surface: Surface | None) -> bool:
    where = settings.surface
    z_mm = (surface or Surface(where.top_mm)).tip_mm(*point[1:])
    place = (where.gel_x_mm + point.x_mm, where.gel_y_mm + point.y_mm, z_mm)
    return any(
        not low - TOLERANCE_MM <= value <= high + TOLERANCE_MM
        for value, low, high in zip(place, box.lowest_mm, box.highest_mm, strict=True)
    )


def _ranges(box: Envelope) -> str:
    return ', '.join(
        f'{axis} {low:g} to {high:g} mm' for axis, low, high in zip(AXES, box.lowest_mm, box.highest_mm, strict=True)
    )
