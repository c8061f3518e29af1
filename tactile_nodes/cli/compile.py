"""``tactile compile``: compile the inner loops before their first use."""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import multiprocessing
import os

from tactile_nodes.clock import monotonic_s
from tactile_nodes.learning.progress import TerminalProgress
from tactile_nodes.paths import cache_directory
from tactile_nodes.sensing.compiling import PARTS, compile_part

DESCRIPTION = 'Compile the inner loops now, so that the first start of a sensor already uses them'
EPILOG = """\
numba stores the compiled code beside the source, or in the user's cache folder if that is not writable. After an update
of the package the code is compiled again. Nodes that start before compilation has finished compute with numpy and start
the compilation in the background.

examples:
  tactile compile
  tactile compile && tactile launch live
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--background', action='store_true', help='use one core at low priority; exit if another process compiles'
    )


def run(arguments: argparse.Namespace) -> int:
    print(_in_background(PARTS) if arguments.background else compile_all(PARTS))
    return 0


def _in_background(parts: tuple[str, ...]) -> str:
    installation = hashlib.sha256(__file__.encode()).hexdigest()[:8]
    with (cache_directory() / f'compiling-{installation}.lock').open('w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return 'another process is compiling the inner loops'
        os.setpriority(os.PRIO_PROCESS, 0, 19)
        return compile_all(parts, most=1)


def compile_all(parts: tuple[str, ...], *, most: int | None = None) -> str:
    """Load each part in a process of its own, up to `most` at once (default: the number of cores); returns a summary.

    Raises:
        ConfigurationError: numba cannot compile them.
    """
    begun_s, processes = monotonic_s(), min(len(parts), most or os.cpu_count() or 1)
    anew = 0
    with (
        TerminalProgress().bar('compiling the inner loops', len(parts)) as bar,
        multiprocessing.get_context('spawn').Pool(processes, maxtasksperchild=1) as pool,
    ):
        for compiled in pool.imap_unordered(compile_part, parts, chunksize=1):
            anew += compiled
            bar.advance()
    if not anew:
        return 'all inner loops were already compiled'
    return f'compiled {anew} of {len(parts)} parts in {monotonic_s() - begun_s:.0f} s'
