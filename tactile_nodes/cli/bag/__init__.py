"""`tactile bag`: record, inspect, play and compare recordings, with the commands and flags of ``ros2 bag``."""

from __future__ import annotations

import argparse
import sys
from datetime import datetime

from tactile_nodes.bag.apart import pictures_apart
from tactile_nodes.bag.compare import TIMINGS, compare
from tactile_nodes.bag.mcap_file import COMPRESSIONS
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FLOW_FEATURES, FORCE_DISTRIBUTION, IMAGE
from tactile_nodes.cli.bag import sync as bag_sync
from tactile_nodes.cli.running.session import duration
from tactile_nodes.clock import NS_PER_S

DESCRIPTION = 'Record topics into rosbag2 MCAP folders and play them back.'
EPILOG = """\
examples:
  tactile bag record                          the topics marked as recorded in the topic table, until Ctrl-C
  tactile bag record -o press1 image_raw force_distribution
  tactile bag info press1
  tactile bag play press1 --rate 0.5 --clock
  tactile bag play press1 --topics /image_raw /reference_image
  tactile bag compare press1 press1_again     whether a replay gave the same forces, bit for bit
  tactile bag sync collected_1 --picture sync.png    offset and drift of each recorder's clock
"""
_MEGABYTE = 1_000_000
_DEFAULT_CLOCK_HZ = 40.0  # the default of ros2 bag play
_LABEL = 19


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest='bag_verb', required=True, metavar='record|info|play|compare|sync')
    _add_record(verbs.add_parser('record', help='record topics', description='Record until Ctrl-C.'))
    _add_info(verbs.add_parser('info', help='show the contents of a bag'))
    _add_play(verbs.add_parser('play', help='play a bag', description=_KEYS))
    _add_compare(verbs.add_parser('compare', help='compare two bags bit for bit', description=_BITS))
    bag_sync.add_arguments(
        verbs.add_parser('sync', help="fit the recorders' clocks to each other", description=bag_sync.DESCRIPTION)
    )


_KEYS = 'Play a bag. Keys: space pauses and resumes, right plays one message, up and down change the rate.'

_BITS = (
    'Match the messages of a topic in two recordings by their stamps and compare all numbers bit for bit. '
    'The exit status is 1 if any number differs, or if no messages match.'
)


def _add_record(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('topics', nargs='*', help='default: those marked as recorded in the topic table')
    parser.add_argument('-a', '--all', action='store_true', help='record all topics')
    parser.add_argument('-e', '--regex', default='', help='record the topics that match this regular expression')
    parser.add_argument('-x', '--exclude', '--exclude-regex', default='', help='but not those that match this one')
    parser.add_argument('-o', '--output', default='', help='folder to create (default: rosbag2_<date>)')
    parser.add_argument('-s', '--storage', choices=['mcap'], default='mcap', help='file format')
    parser.add_argument('-b', '--max-bag-size', type=int, default=0, metavar='BYTES', help='split at this size')
    parser.add_argument(
        '-d', '--max-bag-duration', type=duration, default=0.0, metavar='S', help='split after this time'
    )
    parser.add_argument('--duration', type=duration, default=0.0, metavar='S', help='stop when so much is recorded')
    parser.add_argument(
        '--max-cache-size', type=int, default=256 * _MEGABYTE, metavar='BYTES', help='buffer for a slow disk'
    )
    parser.add_argument(
        '--compression',
        '--compression-format',
        choices=list(COMPRESSIONS),
        default='none',
        help='compression of the chunks of the file',
    )
    parser.set_defaults(action=_record)


def _add_info(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bag', help='a folder, a .mcap file or a .db3 file')
    parser.set_defaults(action=_info)


def _add_play(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('bag', help='a folder, a .mcap file or a .db3 file')
    parser.add_argument('-r', '--rate', type=float, default=1.0, help='speed')
    parser.add_argument('-l', '--loop', action='store_true', help='start again at the end')
    parser.add_argument('-p', '--start-paused', action='store_true', help='start paused')
    parser.add_argument('-d', '--delay', type=duration, default=0.0, metavar='S', help='wait before playing')
    parser.add_argument('--start-offset', type=float, default=0.0, metavar='S', help='start this far into the bag')
    parser.add_argument(
        '--clock', type=float, nargs='?', const=_DEFAULT_CLOCK_HZ, default=0.0, metavar='HZ', help='publish /clock'
    )
    parser.add_argument('--topics', nargs='+', default=[], help='play only these')
    parser.add_argument('-m', '--remap', nargs='+', default=[], metavar='FROM:=TO', help='publish under another name')
    parser.set_defaults(action=_play)


def _add_compare(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('first', help='a bag')
    parser.add_argument('second', help='another bag, for example a replay of the first')
    parser.add_argument('--topic', default=FORCE_DISTRIBUTION.name, help='full name of the topic, or its last part')
    parser.add_argument('--ignore', nargs='*', default=sorted(TIMINGS), metavar='FIELD', help='fields that may differ')
    parser.set_defaults(action=_compare)


def _record(arguments: argparse.Namespace) -> int:
    from tactile_nodes.cli.bag.sessions import record

    return record(arguments)


def _play(arguments: argparse.Namespace) -> int:
    from tactile_nodes.cli.bag.sessions import play

    return play(arguments)


def _info(arguments: argparse.Namespace) -> int:
    with BagReader(arguments.bag) as bag:
        apart = pictures_apart(bag, (FORCE_DISTRIBUTION.name, FLOW_FEATURES.name, IMAGE.name))
        print('\n'.join(['', *info_lines(bag), *([f'{"Sensors:":<{_LABEL}}{apart}'] if apart else []), '']))
        _warn(bag)
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    with BagReader(arguments.first) as first, BagReader(arguments.second) as second:
        found = compare(first, second, arguments.topic, arguments.ignore)
        print('\n'.join(found.lines()))
        _warn(first)
        _warn(second)
    return 0 if found.same else 1


def _warn(bag: BagReader) -> None:
    for problem in bag.problems:
        print(f'Warning: {problem}', file=sys.stderr)


def info_lines(bag: BagReader) -> list[str]:
    """The output of ``ros2 bag info``, counted from the files themselves."""
    topics = [
        f'Topic: {topic.name} | Type: {topic.type_name} | Count: {bag.counts.get(topic.name, 0)} | '
        f'Serialization Format: {topic.encoding}'
        for topic in sorted(bag.topics.values(), key=lambda topic: topic.name)
    ]
    entries = [
        ('Files:', [file.name for file in bag.files]),
        ('Bag size:', [size_text(bag.size)]),
        ('Storage id:', [bag.storage_id]),
        ('ROS Distro:', [bag.metadata.ros_distro] if bag.metadata.ros_distro else []),
        ('Duration:', [f'{seconds_text(bag.extent.duration_ns)}s']),
        ('Start:', [date_text(bag.extent.start_ns)]),
        ('End:', [date_text(bag.extent.end_ns)]),
        ('Messages:', [str(bag.extent.messages)]),
        ('Topic information:', topics),
    ]
    return [
        f'{label if number == 0 else "":<{_LABEL}}{line}'.rstrip()
        for label, lines in entries
        for number, line in enumerate(lines)
    ]


def seconds_text(nanoseconds: int) -> str:
    """Nanoseconds as seconds, exactly: '4.531096768'."""
    return f'{nanoseconds // NS_PER_S}.{nanoseconds % NS_PER_S:09d}'


def date_text(nanoseconds: int) -> str:
    """'Apr  2 2020 22:23:55.112411371 (1585866235.112411371)', in local time."""
    date = datetime.fromtimestamp(nanoseconds // NS_PER_S)
    return f'{date:%b} {date.day:>2} {date:%Y %H:%M:%S}.{nanoseconds % NS_PER_S:09d} ({seconds_text(nanoseconds)})'


def size_text(size: int) -> str:
    """'12.6 KiB'"""
    value, units = float(size), ['B', 'KiB', 'MiB', 'GiB', 'TiB']
    while value >= 1024 and len(units) > 1:
        value /= 1024
        units.pop(0)
    return f'{value:.1f} {units[0]}'
