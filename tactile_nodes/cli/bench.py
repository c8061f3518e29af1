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
BENCHMARKS = {
    'accuracy': 'models side by side: accuracy, uncertainty, unlike inputs, size and times',
    'transfer': 'a model on other gels after 10 to 100 presses: error against presses',
    'transfer_partial': 'a model on other gels without a rig: weights, pens, rest images',
    'transfer_paper': "the paper's calibration layer on other gels, and why its published rate does harm",
    'take_over': 'what a recorded calibration shows of the live node: forces before and after, frames lost',
    'drift': 'when the monitor says that a calibration is ageing, and how wrong forces are by then',
    'bus': 'latency and throughput of the bus beside plain pyzmq',
    'dds': 'what showing the nodes in a ROS 2 graph over DDS costs: nobody, one reader, one that hangs',
    'drivers': 'latency, loss and cost of each hardware driver at its highest rate',
    'collection': 'a whole collection in simulated time, into a real bag',
    'faults': 'every fault in the midst of a collection on the emulated rig: what is lost?',
    'stopping': 'how soon and how far a force above its limit stops the tip',
    'firmware': 'real firmware in its own simulator: does it obey, and what does each fault in mid-press come to?',
    'runtimes': 'models in numpy, onnxruntime and torch: time, memory, size, and the same answers',
    'flow': 'motion by each flow method against known motion, and its time',
    'front': 'speed against accuracy: ways to measure motion, grids and readouts, trained alike; the front of them',
    'motion': 'flow alone: error and bias of each way against how far the picture moved',
    'stability': 'each disturbance from none to far too much: does the force hold, and does the status say so?',
    'untouched': 'frames in which nothing touches: are any touches missed, and what does not measuring them save?',
    'latency': 'from capture to force in another process, for minutes; the highest rate without a drop',
    'page': 'what the live view in the browser costs the sensor: nobody, one, five viewers, one that hangs',
    'endurance': 'hours of sensing: does memory, a queue or a count of files or threads grow?',
    'system_faults': 'processes killed, run folder gone, garbage and crowds on the bus: what does sensing lose?',
    'contacts': 'any contact: where, how hard, which shear, by ten families of bodies, in disturbed pictures, too',
    'fingers': 'two fingers that squeeze one object: do their readings agree?',
}


def checkout(package: Path = Path(__file__).parents[1]) -> Path:
    """The checkout of the source that a package lies in.

    Raises:
        ConfigurationError: it was installed somewhere else.
    """
    root = package.resolve().parent
    if (root / 'package.xml').is_file() and (root / 'benchmarks' / '__init__.py').is_file():
        return root
    raise ConfigurationError(
        f'benchmarks run from a checkout of the source, and {package} is an installed package: in the checkout, '
        'install it with "pip install --editable ." and run "tactile bench" again'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One subcommand a benchmark; each is a module of `benchmarks` with `add_arguments` and `run`.

    All run with one thread of linear algebra, as the live nodes do, unless the environment says otherwise.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before a benchmark imports numpy, which looks but once
    sys.path.insert(0, str(checkout()))
    benchmarks = parser.add_subparsers(dest='benchmark', required=True, metavar='benchmark')
    for name, text in BENCHMARKS.items():
        module = importlib.import_module(f'benchmarks.{name}')
        made = benchmarks.add_parser(name, help=text, description=module.__doc__)
        module.add_arguments(made)
        made.epilog = made.epilog or f'example: tactile bench {name}'


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen one; what it has started ends with it, by SIGTERM too."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    status: int = importlib.import_module(f'benchmarks.{arguments.benchmark}').run(arguments)
    return status
