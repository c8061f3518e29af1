"""``tactile compile``: the inner loops, ahead of their first use."""

from __future__ import annotations

import argparse
import multiprocessing
import os

from tactile_nodes.clock import monotonic_s
from tactile_nodes.learning.progress import TerminalProgress
from tactile_nodes.sensing.compiling import PARTS, compile_part

DESCRIPTION = 'Compile the inner loops for compiled:=true now, so that the first start of a sensor need not'
EPILOG = """\
numba keeps what it compiled beside the source, or in the user's cache folder where that cannot be written. An update of
the package compiles anew. Needs: pip install 'tactile_nodes[compiled]'

examples:
  tactile compile
  tactile compile && tactile launch live compiled:=true
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """There are none."""


def run(arguments: argparse.Namespace) -> int:
    """Compile what is not compiled yet, on all cores."""
    del arguments
    print(compile_all(PARTS))
    return 0


def compile_all(parts: tuple[str, ...]) -> str:
    """Load each part in a process of its own, and say what that took.

    Raises:
        ConfigurationError: numba is not installed.
    """
    begun_s, processes = monotonic_s(), min(len(parts), os.cpu_count() or 1)
    anew = 0
    with (
        TerminalProgress().bar('compiling the inner loops', len(parts)) as bar,
        multiprocessing.get_context('spawn').Pool(processes, maxtasksperchild=1) as pool,
    ):
        for compiled in pool.imap_unordered(compile_part, parts, chunksize=1):
            anew += compiled
            bar.advance()
    if not anew:
        return 'all inner loops were compiled before; compiled:=true starts at once'
    return (
        f'compiled {anew} of {len(parts)} parts in {monotonic_s() - begun_s:.0f} s; compiled:=true starts at once now'
    )
