"""A plot for each family of disturbances: relative error against the level; the colour is the status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.stability.aims import TWICE, WITHIN, Point, points_of
from benchmarks.stability.page import picture_of

COLOURS = {'ok': 'tab:green', 'degraded': 'tab:orange', 'invalid': 'tab:red'}
STYLES, MARKS = ('-', '--', ':', '-.'), 'os^Dv'
LEAST, MOST = 0.2, 300.0
ACROSS = 4


def draw(result: Mapping[str, Any], folder: Path, name: str) -> None:
    """Write the plot of every family. Raises ConfigurationError without matplotlib."""
    points = points_of(result)
    for family in dict.fromkeys(each.family for each in points):
        own = [each for each in points if each.family == family]
        _family(own, family, result['profiles'], folder / picture_of(family, name))


def _family(points: Sequence[Point], family: str, profiles: Sequence[str], file: Path) -> None:
    from tactile_nodes.learning.figures import figure, save

    names = list(dict.fromkeys(each.name for each in points))
    down = -(-len(names) // ACROSS)
    drawn = figure(3.4 * min(ACROSS, len(names)) + 0.6, 2.7 * down + 0.5)
    axes = drawn.subplots(down, min(ACROSS, len(names)), squeeze=False, sharey=True).ravel()
    for axis, name in zip(axes, names, strict=False):
        _case(axis, [each for each in points if each.name == name], profiles)
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    for row in range(down):
        axes[row * min(ACROSS, len(names))].set_ylabel('error / undisturbed')
    _legend(axes[0], profiles)
    drawn.suptitle(f'{family}: force error on held frames; colour: what most of them say')
    save(drawn, file, dpi=90)


def _case(axis: Any, points: Sequence[Point], profiles: Sequence[str]) -> None:
    levels = list(dict.fromkeys(each.level for each in points))
    for number, profile in enumerate(profiles):
        own = [each for each in points if each.profile == profile]
        heights = [_height(each) for each in own]
        axis.plot(range(len(own)), heights, STYLES[number % 4], color='0.6', linewidth=1, zorder=1)
        colours = [COLOURS[_status(each)] for each in own]
        axis.scatter(range(len(own)), heights, c=colours, marker=MARKS[number % 5], s=26, zorder=2)
    for height in (1.0, WITHIN, TWICE):
        axis.axhline(height, color='0.8', linewidth=0.6, zorder=0)
    axis.set_yscale('log')
    axis.set_ylim(LEAST, MOST)
    axis.set_xticks(range(len(levels)), [f'{level:g}' for level in levels])
    axis.set_title(points[0].name, fontsize=9)
    axis.set_xlabel(points[0].unit, fontsize=8)


def _height(point: Point) -> float:
    """The height of a mark; without a force it is at the top."""
    return MOST if point.ratio is None else min(max(point.ratio, LEAST), MOST)


def _status(point: Point) -> str:
    if point.score['held_invalid'] >= 0.5:
        return 'invalid'
    return 'ok' if point.score['held_ok'] >= 0.5 else 'degraded'


def _legend(axis: Any, profiles: Sequence[str]) -> None:
    for number, profile in enumerate(profiles):
        axis.plot([], [], STYLES[number % 4], marker=MARKS[number % 5], color='0.5', label=profile)
    for status, colour in COLOURS.items():
        axis.plot([], [], 'o', color=colour, label=status)
    axis.legend(fontsize=6, loc='upper left')
