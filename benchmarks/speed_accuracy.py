"""The chart of speed against accuracy: one panel for tips (`front`), one for any contact (`contacts`).

Both benchmarks draw it, each from its own result and the result of the other in the same folder.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.running import read
from tactile_nodes.sensing.metrics import pareto_front

CHART = 'speed_accuracy.png'
COLOURS = {'paper': 'black', 'fast': 'tab:orange', 'portable': 'tab:green', 'field': 'tab:blue'}
OF_BEFORE = 'tab:gray'
"""For models in a stored result that are no longer shipped."""
WAYS = {
    'ours': 'o', 'DIS': 's', 'Farneback': '^', 'TV-L1': 'v', 'pyramidal LK': 'D', 'phase correlation': 'P',
    'small pixels': 'X',
}  # fmt: skip
"""Marks of flow methods, by the beginning of their names."""
TIPS, CONTACTS = 'tips', 'any contact'
TITLES = {TIPS: 'One ball tip', CONTACTS: 'Any contact'}
TIME = 'CPU time per frame, from image to message [ms]'
ERRORS = {TIPS: 'error per bin, aRMSE [mN]', CONTACTS: 'force in the wrong bins [%]'}
Place = tuple[float, float]
PLACES = [
    (round(away * math.cos(angle), 3), round(away * math.sin(angle), 3))
    for away in (12, 18, 26, 36, 48, 62, 78, 96)
    for angle in np.arange(0, 2 * math.pi, math.pi / 12)
]
"""Possible places of a name relative to its mark, the nearest first, in points."""
MARK_PX = 8
LIMITS = {TIPS: ((0.08, 700.0), (0.06, 60.0)), CONTACTS: ((0.5, 30.0), (0.0, 70.0))}
TICKS_MN = (0.1, 0.3, 1, 3, 10, 30)
TICKS_MS = {TIPS: (0.1, 1, 10, 100), CONTACTS: (0.5, 1, 2, 5, 10, 20)}


@dataclass(frozen=True)
class Mark:
    """A model on the chart: time in ms, error, and the time of its slowest frames, if known."""

    name: str
    time_ms: float
    error: float
    shipped: bool
    slow_ms: float | None = None

    @property
    def colour(self) -> str:
        return next((colour for model, colour in COLOURS.items() if self.name.startswith(model)), OF_BEFORE)


def draw_tips(result: Mapping[str, Any], folder: Path, _: str) -> None:
    """Draw the chart after `front`."""
    _draw({TIPS: result, CONTACTS: read(folder / 'contacts.json', missing={})}, folder / CHART)


def draw_contacts(result: Mapping[str, Any], folder: Path, _: str) -> None:
    """Draw the chart after `contacts`."""
    _draw({TIPS: read(folder / 'front.json', missing={}), CONTACTS: result}, folder / CHART)


def _draw(results: Mapping[str, Mapping[str, Any]], file: Path) -> None:
    from tactile_nodes.learning.figures import figure, save

    shown = {name: result for name, result in results.items() if result}
    drawn = figure(7.5 * len(shown), 6.5)
    for axis, (name, result) in zip(drawn.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        panel(axis, name, result)
    save(drawn, file, dpi=110)


def panel(axis: Any, name: str, result: Mapping[str, Any]) -> list[Any]:
    """Draw one panel; returns its labels."""
    (left, right), (bottom, top) = LIMITS[name]
    axis.set(xscale='log', xlim=(left, right), ylim=(bottom, top))
    axis.set_yscale('log' if name == TIPS else 'linear')
    axis.set_xlabel(TIME, fontsize=12)
    axis.set_ylabel(ERRORS[name], fontsize=12)
    if name == TIPS:
        axis.set_yticks(TICKS_MN, [f'{each:g}' for each in TICKS_MN])
    axis.set_title(TITLES[name], fontsize=12)
    axis.set_xticks(TICKS_MS[name], [f'{each:g}' for each in TICKS_MS[name]])
    axis.minorticks_off()
    axis.grid(linewidth=0.4)
    others = _ways(axis, result) if name == TIPS else []
    marks = tip_marks(result) if name == TIPS else contact_marks(result)
    if name == CONTACTS:
        axis.axvline(result['dis_ms'], color='grey', linestyle=':', label="OpenCV's DIS (medium) alone")
    labels = _models(axis, marks, [*others, *((each.time_ms, each.error) for each in marks)])
    _legend(axis, name)
    return labels


def tip_marks(result: Mapping[str, Any]) -> list[Mark]:
    """The shipped models with their whole chains, and the method of `portable` with few presses; errors in mN."""
    shipped = [
        Mark(name, each['chain_cpu_ms']['median'], 1e3 * each['armse_n'], True)
        for name, each in result['profiles'].items()
    ]
    few = [
        Mark(f'portable, {result["plan"]["train"]} presses', each['cpu_ms']['median'], 1e3 * each['armse_n'], False)
        for each in result['contenders'].values() if _as_portable(each)
    ]  # fmt: skip
    return shipped + few


def _as_portable(contender: Mapping[str, Any]) -> bool:
    return bool(contender['readout'] == 'axisymmetric' and contender['way'].startswith('ours'))


def contact_marks(result: Mapping[str, Any]) -> list[Mark]:
    """All chains, errors in percent. The shipped ones are used unchanged; the others were calibrated on this gel."""
    return [
        Mark(
            name, each['cpu_ms'], 100 * each['misplaced'],
            'presses' not in name, each['cpu_95_ms'],
        )
        for name, each in result['models'].items()
    ]  # fmt: skip


def _ways(axis: Any, result: Mapping[str, Any]) -> list[Place]:
    """Draw the contenders with equal training, marked by flow method; returns their places.

    No launch can run most of them, so their times are those of flow and readout alone.
    """
    places: dict[str, list[Place]] = {way: [] for way in WAYS}
    for each in result['contenders'].values():
        if _as_portable(each):
            continue
        way = next(way for way in WAYS if each['way'].startswith(way))
        places[way].append((each['cpu_ms']['median'], 1e3 * each['armse_n']))
    for way, found in ((way, found) for way, found in places.items() if found):
        axis.scatter(*zip(*found, strict=True), marker=WAYS[way], s=24, facecolor='0.75', edgecolor='0.45', label=way)
    return [place for found in places.values() for place in found]


def _models(axis: Any, marks: Sequence[Mark], points: Sequence[Place]) -> list[Any]:
    """Draw the models with their names, and the front of all points; returns the labels."""
    front = [points[i] for i in pareto_front(*zip(*points, strict=True))]
    if len(front) > 1:
        axis.step(*zip(*front, strict=True), 'k-', where='post', linewidth=0.8, zorder=1, label='Pareto front')
    for each in marks:
        filled = each.colour if 'compiled' not in each.name else 'white'
        kind = {'marker': '*', 's': 190} if each.shipped else {'marker': 'o', 's': 70}
        axis.scatter(each.time_ms, each.error, color=filled, edgecolor=each.colour, linewidth=1.4, zorder=3, **kind)
        if each.slow_ms is not None:
            axis.plot([each.time_ms, each.slow_ms], [each.error] * 2, color=each.colour, linewidth=1, zorder=2)
    corners = [(after[0], before[1]) for before, after in itertools.pairwise(front)]
    steps = [place for pair in zip(front, corners, strict=False) for place in pair] + front[-1:]
    lines = [*itertools.pairwise(steps), *(((m.time_ms, m.error), (m.slow_ms, m.error)) for m in marks if m.slow_ms)]
    return _labelled(axis, marks, points, lines)


def _labelled(
    axis: Any, marks: Sequence[Mark], points: Sequence[Place], lines: Sequence[tuple[Place, Place]]
) -> list[Any]:
    """Write each name as near to its mark as possible without covering a mark, a line or another name."""
    axis.figure.draw_without_rendering()
    to_px = axis.transData.transform
    taken = [_around(to_px(place), MARK_PX) for place in points]
    taken += [_around(place, 2) for begin, end in lines for place in _along(to_px(begin), to_px(end))]
    made: list[Any] = []
    for each in marks:
        label = next(filter(None, (_tried(axis, each, place, taken, made) for place in PLACES)), None)
        if label is not None:
            taken += [box_of(label), *(_around(place, 1) for place in _leader(axis, each, label))]
            made.append(label)
    return made


def _tried(axis: Any, mark: Mark, away: Place, taken: Sequence[Any], others: Sequence[Any]) -> Any:
    """Write a name at `away` points from its mark; None if it would cover something or leave the panel."""
    label = axis.annotate(
        mark.name, (mark.time_ms, mark.error), away, textcoords='offset points', fontsize=10, color=mark.colour,
        ha='left' if away[0] > 0 else 'right' if away[0] < 0 else 'center', va='center',
        arrowprops={'arrowstyle': '-', 'color': mark.colour, 'linewidth': 0.6, 'shrinkB': 5},
    )  # fmt: skip
    box, room = box_of(label), axis.get_window_extent()
    free = room.contains(*box.min) and room.contains(*box.max) and not any(box.overlaps(each) for each in taken)
    if free and not any(box_of(each).contains(*place) for place in _leader(axis, mark, label) for each in others):
        return label
    label.remove()
    return None


def _leader(axis: Any, mark: Mark, label: Any) -> list[Place]:
    """The line from a mark to its name, in pixels, without its parts under the mark and the name."""
    box = box_of(label)
    way = _along(axis.transData.transform((mark.time_ms, mark.error)), ((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2))
    return [each for each in way[4:] if not box.contains(*each)]


def _along(begin: Place, end: Place) -> list[Place]:
    """Places on a line."""
    return [(float(x), float(y)) for x, y in np.linspace(begin, end, 30)]


def box_of(label: Any) -> Any:
    """The box of a label's text, without its line, in pixels."""
    from matplotlib.text import Text

    label.update_positions(label.figure.canvas.get_renderer())
    return Text.get_window_extent(label)


def _around(place: Place, half: float) -> Any:
    from matplotlib.transforms import Bbox

    x, y = place
    return Bbox([[x - half, y - half], [x + half, y + half]])


def _legend(axis: Any, name: str) -> None:
    """Draw the legend of a panel's marks."""
    if name == TIPS:
        kinds = {
            'shipped model, trained on more presses': ('*', 13, 'black'),
            'the same, compiled': ('*', 13, 'white'),
            'trained as the grey ones': ('o', 8, 'black'),
        }
    else:
        kinds = {
            'shipped model': ('*', 13, 'black'),
            'calibrated on this gel, or described': ('o', 8, 'black'),
            'the same, compiled': ('o', 8, 'white'),
        }
        axis.plot([], [], 'k-', linewidth=1, label='up to the 95th percentile')
    for label, (marker, size, colour) in kinds.items():
        axis.plot([], [], marker, markersize=size, markerfacecolor=colour, markeredgecolor='black', label=label)
    if name == TIPS:
        title = 'grey: flow and readout alone, with the same training'
        axis.legend(fontsize=9, title=title, title_fontsize=9, ncols=2, loc='center right', bbox_to_anchor=(1.0, 0.48))
    else:
        axis.legend(fontsize=9, loc='center left', bbox_to_anchor=(0.0, 0.38))
