"""``tactile gels``: the calibrations of this lab, and which of them are due."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running.columns import columns
from tactile_nodes.cli.running.session import positive_float

if TYPE_CHECKING:
    from tactile_nodes.gel_list import Calibration, GelList

DESCRIPTION = """\
List the calibrations of this lab: the gel, the number of presses, the error, and the drift since then.

`tactile calibrate` and `tactile launch calibrate` add their results. The drift monitor of a live launch stores its
findings."""
EPILOG = """\
examples:
  tactile gels                            all calibrations; those that are due are marked
  tactile gels --after 30                 also mark those older than 30 days as due
  tactile gels add gel-7.safetensors      add a calibration that was made elsewhere or earlier
  tactile gels look collected_1           read the drift monitor's findings from bags
  tactile gels forget 6faa5caaacb8        remove it from the list; the model file stays

The list is one SQLite file, ~/.local/share/tactile_nodes/gels.sqlite or the file in TACTILE_GELS.
"""
AFTER_DAYS = 90.0
HEAD = ('model', 'gel', 'sensor', 'made', 'presses', 'error [mN]', 'drift', 'due')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--after', type=positive_float, default=AFTER_DAYS, metavar='DAYS', help='age at which a calibration is due'
    )
    parser.add_argument('--json', action='store_true', help='print the list as JSON')
    actions = parser.add_subparsers(dest='action', metavar='add|look|forget')
    add = actions.add_parser('add', help='add model files to the list')
    add.add_argument('models', nargs='+', help='calibrated model files')
    add.add_argument('--sensor', default='', help='the sensor that holds the gel')
    look = actions.add_parser('look', help='read the findings of the drift monitor from bags')
    look.add_argument('bags', nargs='+', help='bags of live sensing')
    forget = actions.add_parser('forget', help='remove a calibration from the list')
    forget.add_argument('model_id', help='its model id, as in the list')


def run(arguments: argparse.Namespace) -> int:
    from tactile_nodes.gel_list import GelList

    gels = GelList()
    if arguments.action == 'add':
        return _add(gels, arguments.models, arguments.sensor)
    if arguments.action == 'look':
        return _look(gels, arguments.bags)
    if arguments.action == 'forget':
        return _forget(gels, arguments.model_id)
    return _list(gels, arguments.after, as_json=arguments.json)


def _add(gels: GelList, models: list[str], sensor: str) -> int:
    from tactile_nodes.gel_list import TOO_LATE_NS
    from tactile_nodes.learning.calibrating.listing import calibration_of

    for name in models:
        file = Path(name)
        written_ns = file.stat().st_mtime_ns if file.exists() else 0
        found = calibration_of(file, sensor=sensor, made_ns=written_ns if written_ns < TOO_LATE_NS else 0)
        gels.add(found)
        print(f'{name}: model {found.model_id} of gel {found.gel or "(not named)"} was added to the list')
    return 0


def _look(gels: GelList, bags: list[str]) -> int:
    from tactile_nodes.bag.reader import BagReader
    from tactile_nodes.bus.topics import CALIBRATION_STATE
    from tactile_nodes.pipeline.drifting import kept_in

    for path in bags:
        with BagReader(path) as bag:
            topics = [name for name in bag.topics if name.rpartition('/')[2] == CALIBRATION_STATE.name.strip('/')]
            states = [bag.decode(message) for message in bag.messages(topics)] if topics else []
        count = sum(kept_in(gels, state) for state in states)
        print(f'{path}: {count} of {len(states)} drift states belong to calibrations on the list')
    return 0


def _forget(gels: GelList, model_id: str) -> int:
    from tactile_nodes.errors import ConfigurationError

    if not gels.forget(model_id):
        raise ConfigurationError(f'{gels.file} has no model {model_id}; see: tactile gels')
    print(f'{model_id} was removed from the list; its file was not touched')
    return 0


def _list(gels: GelList, after_days: float, *, as_json: bool) -> int:
    from tactile_nodes.clock import wall_ns

    now_ns, found = wall_ns(), gels.calibrations()
    newest = {(each.gel or each.model_id, each.source): each for each in reversed(found)}.values()
    due = [each.due(now_ns, after_days if each in newest else math.inf) for each in found]
    if as_json:
        print(json.dumps([{**asdict(each), 'due': why} for each, why in zip(found, due, strict=True)], indent=1))
        return 0
    if not found:
        print(f'no calibrations in {gels.file} yet; tactile calibrate adds its results, tactile gels add adds others')
        return 0
    print(columns([HEAD, *map(_row, found, due)]))
    return 0


def _row(each: Calibration, due: str) -> tuple[str, ...]:
    return (
        each.model_id, each.gel or '-', each.sensor or '-', _date(each.made_ns), str(each.presses or '-'),
        '-' if each.error_n is None else f'{1e3 * each.error_n:.1f}',
        f'{each.level} {_date(each.looked_ns)}' if each.level else 'not known',
        due if Path(each.file).exists() else f'{due + "; " if due else ""}its file is missing: {each.file}',
    )  # fmt: skip


def _date(at_ns: int) -> str:
    return f'{datetime.fromtimestamp(at_ns / 1e9):%Y-%m-%d}' if at_ns else '-'
