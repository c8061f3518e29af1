"""The verb that measures."""

from __future__ import annotations

import signal
import subprocess
import sys

SLOW = """
import argparse, sys, time, types
from tactile_nodes.cli import bench

def run(arguments):
    try:
        print('begun', flush=True)
        time.sleep(60)
    finally:
        print('cleaned up', flush=True)

slow = types.ModuleType('tactile_nodes.benchmarks.slow')
slow.run = run
sys.modules['tactile_nodes.benchmarks.slow'] = slow
bench.run(argparse.Namespace(benchmark='slow'))
"""


def test_a_benchmark_that_is_terminated_cleans_up() -> None:
    with subprocess.Popen(
        [sys.executable, '-c', SLOW], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == 'begun\n'
        program.send_signal(signal.SIGTERM)
        assert program.stdout.read() == 'cleaned up\n'
