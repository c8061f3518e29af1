"""``tactile dataset``: training sets from the bags of a collection, or from pictures and a table."""

from __future__ import annotations

import argparse
from pathlib import Path

from tactile_nodes.cli.dataset import building, importing
from tactile_nodes.cli.running.columns import columns
from tactile_nodes.cli.running.session import Verbs

DESCRIPTION = 'Build a training set from the bags of a collection, or from pictures and a table; show what it holds.'
EPILOG = """\
examples:
  tactile dataset build collected_1 collected_2 -o presses.npz --gel gel-7
  tactile dataset build collected_1 -o presses.npz --profile portable
  tactile dataset build new_gel_bag -o new_gel.npz --profile portable --frames each    # for tactile calibrate
  tactile dataset import presses.csv -o presses.npz --gel gel-7        # pictures beside the table, no rig
  tactile dataset import times.csv --pictures video.mp4 -o presses.npz --model mine.safetensors
  tactile dataset import ball.csv punch.parquet -o presses.npz --sensor mine.yaml
  tactile dataset info presses.npz --picture presses.png
  tactile train --dataset presses.npz -o gel-7.safetensors
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    building.add_arguments(verbs.add('build', building.run, 'build a data set from bags'))
    importing.add_arguments(verbs.add('import', importing.run, 'build a data set from pictures and a table'))
    info = verbs.add('info', _info, 'show what a data set holds')
    info.add_argument('file', type=Path, help='a data set')
    info.add_argument(
        '--picture', type=Path, metavar='FILE.png', help='draw coverage, force against depth, forces and a label'
    )
    info.add_argument('--left-out', action='store_true', help='list every attempt that was left out')


def _info(arguments: argparse.Namespace) -> int:
    from tactile_nodes.learning.datasets.file import load_dataset
    from tactile_nodes.learning.datasets.report import report

    presses = load_dataset(arguments.file)
    print(report(presses))
    if arguments.left_out:
        names, entries = presses.card['bag_names'], ('press', 'attempt', 'reason', 'detail')
        rows = [(names[each['bag']], *(str(each[entry]) for entry in entries)) for each in presses.card['left_out']]
        print(columns([('bag', *entries), *rows]))
    if arguments.picture:
        from tactile_nodes.learning.datasets.picture import draw

        draw(presses, arguments.picture)
        print(f'wrote {arguments.picture}')
    return 0
