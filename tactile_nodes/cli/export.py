"""``tactile export``: convert bags to the data formats of robot learning. (Models: ``tactile model export``.)"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_nodes.exporting.episodes import Limit
    from tactile_nodes.exporting.source import Source
    from tactile_nodes.learning.progress import Progress

DESCRIPTION = 'Convert bags to parquet tables, zarr arrays or a LeRobot data set. (Models: tactile model export.)'
EPILOG = """\
examples:
  tactile export parquet grasp1                       grasp1_parquet/, one file per topic, one row per message
  tactile export zarr grasp1 -o grasp1.zarr --images  the same as arrays, and the pictures
  tactile export lerobot grasp1 grasp2 -o grasps --fps 30 --task 'pick up the cup'
  tactile export lerobot grasp1 -o grasps --state /joint_states --action /joint_commands --images
  tactile export lerobot calibration/rosbag2_… -o presses --cut presses    a bag of: tactile launch calibrate
"""
_WRITERS = ('parquet', 'zarr')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    formats = parser.add_subparsers(dest='format', required=True, metavar='parquet|zarr|lerobot')
    for name, line in (
        ('parquet', 'one file per topic, one row per message'),
        ('zarr', 'one array per field of each topic; images too with --images'),
        ('lerobot', 'a LeRobot data set (v3.0): frames at a fixed rate, in episodes'),
    ):
        verb = formats.add_parser(name, help=line)
        _add_common(verb, name)
    _add_lerobot(verb)


def _add_common(parser: argparse.ArgumentParser, name: str) -> None:
    if name in _WRITERS:
        parser.add_argument('bag', type=Path, help='a folder, a .mcap file or a .db3 file')
    else:
        parser.add_argument('bag', type=Path, nargs='+', help='folders, .mcap files or .db3 files')
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FOLDER', help=f'folder to create (default: BAG_{name}, here)'
    )
    parser.add_argument('--topics', nargs='+', default=[], metavar='TOPIC', help='only these; full names or last parts')
    parser.add_argument('--exclude', nargs='+', default=[], metavar='TOPIC', help='all topics except these')
    if name != 'parquet':
        parser.add_argument('--images', action='store_true', help='include images')
    parser.add_argument('--force', action='store_true', help='replace an existing export')


def _add_lerobot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--fps', type=int, default=30, help='frames a second (30)')
    parser.add_argument(
        '--pick', choices=['previous', 'nearest'], default='previous',
        help='message of each topic for a frame: the last one before it (default), or the nearest, perhaps later',
    )  # fmt: skip
    parser.add_argument(
        '--cut', choices=['bag', 'presses'], default='bag', help='one episode per bag (default), or per press'
    )
    parser.add_argument('--task', default='touch', metavar='TEXT', help='description of the task (default: touch)')
    parser.add_argument('--robot', default='unknown', metavar='NAME', help='type of robot, for info.json')
    parser.add_argument('--state', default='', metavar='TOPIC', help='the topic that becomes observation.state')
    parser.add_argument('--action', default='', metavar='TOPIC', help='the topic that becomes action')


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.exporting.output import made_whole
    from tactile_nodes.learning.progress import TerminalProgress

    first = arguments.bag if isinstance(arguments.bag, Path) else arguments.bag[0]
    bag = Path(os.path.realpath(first))  # a folder may have a dot in its name
    output = arguments.output or Path(f'{bag.name if bag.is_dir() else bag.stem}_{arguments.format}')
    facts = {'format': arguments.format, 'command': shlex.join(['tactile', *sys.argv[1:]])}
    write = _lerobot if arguments.format == 'lerobot' else _tables
    with made_whole(output, replace=arguments.force) as folder:
        lines = write(arguments, folder, facts, TerminalProgress())
    print('\n'.join([f'{output}: {lines[0]}', *lines[1:]]))
    return 0


def _tables(arguments: argparse.Namespace, folder: Path, facts: dict[str, Any], progress: Progress) -> list[str]:
    from tactile_nodes.exporting.parquet import export_parquet
    from tactile_nodes.exporting.source import Source
    from tactile_nodes.exporting.zarr_store import export_zarr

    writers: dict[str, Callable[..., int]] = {'parquet': export_parquet, 'zarr': export_zarr}
    images = getattr(arguments, 'images', False)
    with Source(arguments.bag, arguments.topics, arguments.exclude, images=images) as source:
        rows = writers[arguments.format](source, folder, facts, progress)
        _warn(source)
        return [f'{rows} messages of {len(source.layouts)} topics', *_left_out(source.left_out)]


def _lerobot(arguments: argparse.Namespace, folder: Path, facts: dict[str, Any], progress: Progress) -> list[str]:
    from tactile_nodes.exporting.lerobot import Plan, export_lerobot

    plan = Plan(
        arguments.fps, arguments.pick, arguments.cut, arguments.task, arguments.robot, arguments.state,
        arguments.action, tuple(arguments.topics), tuple(arguments.exclude), arguments.images,
    )  # fmt: skip
    left_out: dict[str, str] = {}
    ends: list[str] = []

    def over(source: Source, start: Limit, end: Limit) -> None:
        _warn(source)
        left_out.update(source.left_out)
        if start.skipped_s:
            begin = f'the first {start.skipped_s:.2f} s of the forces, before the first message of {start.topic}'
            ends.append(f'  left out: {begin} ({source.bag.path})')
        if end.skipped_s:
            rest = f'the last {end.skipped_s:.2f} s of the forces, after the last message of {end.topic}'
            ends.append(f'  left out: {rest} ({source.bag.path})')

    meta = export_lerobot(arguments.bag, folder, plan, facts, progress, over)
    keys = ', '.join(feature.key for feature in meta.features)
    counts = f'{meta.frames} frames in {len(meta.episodes)} episodes at {plan.fps} a second'
    return [counts, f'  features: {keys}', *ends, *_left_out(left_out)]


def _left_out(topics: dict[str, str]) -> list[str]:
    return [f'  left out: {topic} ({reason})' for topic, reason in topics.items()]


def _warn(source: Source) -> None:
    provenance = source.provenance
    odd = [
        f'{source.bag.path}: messages of {topic} that cannot be read and were left out: {count}'
        for topic, count in provenance.malformed.items()
    ]
    for problem in [*source.bag.problems, *odd]:
        print(f'Warning: {problem}', file=sys.stderr)
