"""``tactile bench``: measure this machine with the benchmarks that the documentation quotes."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from pathlib import Path

from tactile_nodes.errors import ConfigurationError

DESCRIPTION = 'Run the benchmarks of the documentation on this machine. Needs a checkout of the source.'
EPILOG = """\
examples:
  tactile bench --help
  tactile bench status            results in docs/results that are older than the code they measured
  tactile bench front -o results  measure, and write results/front.json, .md and a chart
"""


def checkout(package: Path = Path(__file__).parents[1]) -> Path:
    """The source checkout that contains a package.

    Raises:
        ConfigurationError: the package was installed elsewhere.
    """
    root = package.resolve().parent
    if (root / 'package.xml').is_file() and (root / 'benchmarks' / '__init__.py').is_file():
        return root
    raise ConfigurationError(
        f'this needs a checkout of the source, and {package} is an installed package: in the checkout, install it '
        'with "pip install --editable ." and run it again'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One subcommand per benchmark, from `benchmarks.catalogue` of the checkout.

    All run with one linear-algebra thread, as the live nodes do, unless the environment variable is set.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before a benchmark imports numpy, which reads it only once
    sys.path.insert(0, str(checkout()))
    importlib.import_module('benchmarks.catalogue').add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen benchmark; its child processes end with it, also on SIGTERM."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    status: int = importlib.import_module('benchmarks.catalogue').run(arguments)
    return status
