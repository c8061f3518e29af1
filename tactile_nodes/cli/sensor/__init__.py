"""``tactile sensor``: make the description of a sensor from its pictures, and check pictures against one."""

from __future__ import annotations

import argparse

from tactile_nodes.cli.running.session import Verbs
from tactile_nodes.cli.sensor import check, new

DESCRIPTION = (
    'Make the description of a sensor from its pictures and a few questions, or check pictures against a description.'
)
EPILOG = """\
examples:
  tactile sensor new /dev/video0 -o mine.yaml                       asks what no picture shows, and draws mine.png
  tactile sensor new rest.png -o mine.yaml --width 19 --thickness 4 --yes
  tactile sensor new pictures/ -o mine.yaml --width 19 --camera-info ost.yaml
  tactile sensor check mine.yaml /dev/video0                        prints findings, and draws mine_check.png
  tactile sensor check printed_dots simulated                       a shipped sensor against its own simulation
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    new.add_arguments(verbs.add('new', new.run, 'describe a sensor from rest images and a few questions'))
    check.add_arguments(verbs.add('check', check.run, 'check rest images against a description'))
