"""``tactile bench``: measure this machine with the benchmarks that the documentation quotes."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from pathlib import Path

from tactile_nodes.errors import ConfigurationError

DESCRIPTION = 'Measure, on this machine, what the documentation claims of another. Runs from a checkout of the source.'
EPILOG = """\
examples:
  tactile bench --help
  tactile bench status            which results in docs/results are older than what they measured
  tactile bench front -o results  measure, and write results/front.json, .md and a chart
"""


def checkout(package: Path = Path(__file__).parents[1]) -> Path:
    """The checkout of the source that a package lies in.

    Raises:
        ConfigurationError: it was installed somewhere else.
    """
    root = package.resolve().parent
    if (root / 'package.xml').is_file() and (root / 'benchmarks' / '__init__.py').is_file():
        return root
    raise ConfigurationError(
        f'this runs from a checkout of the source, and {package} is an installed package: in the checkout, install it '
        'with "pip install --editable ." and run it again'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One subcommand a benchmark, as `benchmarks.catalogue` of the checkout has them.

    All run with one thread of linear algebra, as the live nodes do, unless the environment says otherwise.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before a benchmark imports numpy, which looks but once
    sys.path.insert(0, str(checkout()))
    importlib.import_module('benchmarks.catalogue').add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen one; what it has started ends with it, by SIGTERM too."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    status: int = importlib.import_module('benchmarks.catalogue').run(arguments)
    return status
