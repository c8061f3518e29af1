"""``tactile camera``: list the cameras."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_nodes.cli.running.columns import columns

if TYPE_CHECKING:
    from tactile_nodes.drivers.camera.v4l2_devices import UsbCamera

DESCRIPTION = 'List the cameras of this machine, each with a source that still finds it after cables were moved.'
EPILOG = """\
examples:
  tactile camera list                    to identify a camera, unplug it and list again
  tactile launch live source:=serial:A1B2
"""
BY_PATH = Path('/dev/v4l/by-path')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest='action', required=True, metavar='list')
    actions.add_parser('list', help='one line per camera: source, device, name')


def run(_: argparse.Namespace) -> int:
    from tactile_nodes.drivers.camera.v4l2_devices import cameras

    found = cameras()
    if not found:
        print('no camera is connected; use source:=simulated to run without one')
        return 0
    rows = [('source', 'device', 'name'), *((source, each.path, each.name) for source, each in sources(found))]
    print(columns(rows))
    return 0


def sources(found: Sequence[UsbCamera], by_path: Path = BY_PATH) -> list[tuple[str, UsbCamera]]:
    """The source of each camera: its serial number if that is unique, else its USB port, else only its device."""
    from tactile_nodes.drivers.camera.contract import SERIAL

    counts = Counter(each.serial for each in found)
    ports = {str(link.resolve()): str(link) for link in sorted(by_path.glob('*'))} if by_path.is_dir() else {}
    return [
        (SERIAL + each.serial if each.serial and counts[each.serial] == 1 else ports.get(each.path, each.path), each)
        for each in found
    ]
