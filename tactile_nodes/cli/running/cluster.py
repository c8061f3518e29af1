"""The ``--on`` argument of commands that simulate."""

from __future__ import annotations

import argparse

PURPOSE = 'simulates presses on a cluster'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """``--on``, for `tactile_nodes.learning.tasks.on_cluster`."""
    parser.add_argument(
        '--on', default='', metavar='tcp://HOST:8786',
        help='simulate on a Dask cluster (default: processes of this machine)',
    )  # fmt: skip
