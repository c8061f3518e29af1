"""``tactile collect``: inspect a plan before anything moves."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_nodes.collection.plan.plan import Plan, Point

DESCRIPTION = 'Show what a plan asks of a rig: its points, their order, the workspace and the duration. Nothing moves.'
EPILOG = """\
examples:
  tactile collect paper                                a plan of config/plans
  tactile collect my_points.yaml --draw path.png       draws the path (needs matplotlib)
  tactile launch collect plan:=paper                   runs the plan
"""
HEIGHT_MM = 4.0  # usual safe height above the gel
TOP_MM = 1.0  # usual height above the gel from which the surface search starts
SHOWN = 150  # presses whose path is drawn: more cannot be distinguished


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('plan', help='YAML file of a plan, or the name of one in config/plans')
    parser.add_argument('--draw', type=Path, metavar='FILE', help='draw positions and path as PNG, PDF or SVG')
    parser.add_argument('--points', action='store_true', help='print every press in order')


def run(arguments: argparse.Namespace) -> int:
    """Print, and draw if asked; 0."""
    from tactile_nodes.collection.plan.order import ordered
    from tactile_nodes.collection.plan.plan import load_plan_settings, make_plan, plan_path
    from tactile_nodes.collection.run.estimate import estimate
    from tactile_nodes.collection.settings import CollectionSettings
    from tactile_nodes.drivers.cnc.contract import CncSettings

    file = plan_path(arguments.plan)
    settings = load_plan_settings(file)
    plan = make_plan(settings)
    order = ordered(plan, settings)
    print(f'plan {plan.plan_id} from {file}')
    print(_box(plan))
    collection = CollectionSettings()
    surface_mm = collection.surface.top_mm - TOP_MM
    cnc = CncSettings(safe_z_mm=surface_mm + HEIGHT_MM)
    print(estimate(plan.plan_id, order, collection, cnc, surface_mm).describe())
    if arguments.points:
        for point in order:
            print(f'{point.press:6d}  x {point.x_mm:8.3f}  y {point.y_mm:8.3f}  depth {point.depth_mm:.3f} mm')
    if arguments.draw is not None:
        _draw(order, arguments.draw)
        print(f'wrote {arguments.draw}')
    return 0


def _box(plan: Plan) -> str:
    left, near, right, far = plan.box_mm
    return f'x {left:g} to {right:g} mm, y {near:g} to {far:g} mm from the middle, at most {plan.deepest_mm:g} mm deep'


def _draw(order: Sequence[Point], file: Path) -> None:
    from tactile_nodes.learning.figures import figure, save

    drawing, shown = figure(7.5, 6.5), order[:SHOWN]
    title = f'{len(order)} presses, seen from above; path of the first {len(shown)}'
    axes = drawing.add_subplot(aspect='equal', xlabel='x [mm]', ylabel='y [mm]', title=title)
    visits = Counter(point[1:3] for point in order)
    first = {place: number for number, place in reversed(list(enumerate((point[1:3] for point in order), start=1)))}
    axes.plot([point.x_mm for point in shown], [point.y_mm for point in shown], linewidth=0.6, color='0.6', zorder=1)
    sizes = [8 * visits[place] ** 0.5 for place in first]
    drawn = axes.scatter([x for x, _ in first], [y for _, y in first], c=list(first.values()), s=sizes, zorder=2)
    axes.plot(*order[0][1:3], marker='x', color='red', zorder=3)
    axes.annotate(' start', order[0][1:3], color='red')
    drawing.colorbar(drawn, label='number of the first press at this position', shrink=0.8)
    save(drawing, file)
