"""The verb that measures."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_nodes.cli import bench
from tactile_nodes.errors import ConfigurationError

SLOW = """
import argparse, dataclasses, os, time
from tactile_nodes.cli import bench

bench.add_arguments(argparse.ArgumentParser())
import numpy
print(len(os.listdir('/proc/self/task')), flush=True)
from benchmarks.catalogue import BENCHMARKS

def measure(arguments, run):
    try:
        print('begun', flush=True)
        time.sleep(60)
    finally:
        print('cleaned up', flush=True)

BENCHMARKS['slow'] = dataclasses.replace(BENCHMARKS['flow'], measure=measure, arguments=())
bench.run(argparse.Namespace(benchmark='slow'))
"""


def test_a_benchmark_runs_with_one_thread_of_linear_algebra_and_cleans_up_when_it_is_terminated() -> None:
    """OpenBLAS starts its threads when numpy is imported, one for each core but for what the environment says."""
    free = {name: value for name, value in os.environ.items() if not name.endswith('_NUM_THREADS')}
    with subprocess.Popen(
        [sys.executable, '-c', SLOW], env=free, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as program:
        assert program.stdout is not None
        assert [program.stdout.readline() for _ in range(2)] == ['1\n', 'begun\n']
        program.send_signal(signal.SIGTERM)
        assert program.stdout.read() == 'cleaned up\n'


def test_a_package_that_lies_beside_no_benchmarks_says_where_they_run(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match='this needs a checkout of the source') as refused:
        bench.checkout(tmp_path / 'site-packages' / 'tactile_nodes')
    assert 'pip install --editable .' in str(refused.value)
