"""Memory of a flow method: the growth of a separate process."""

from __future__ import annotations

import multiprocessing

import numpy as np
import psutil

SIDE = 440


def memory_mb(way: str) -> float:
    """Growth (MB) of a new process that sets a rest image and measures a few frames with the named method."""
    with multiprocessing.get_context('spawn').Pool(1) as pool:
        grown: float = pool.apply(_grown_mb, (way,))
    return grown


def _grown_mb(name: str) -> float:
    from benchmarks.front.contenders import WAYS, Measuring, one_thread

    one_thread()
    way = next(each for each in WAYS if each.name == name)
    random = np.random.default_rng(1)
    rest = random.integers(10, 200, (SIDE, SIDE), dtype=np.uint8)
    before = psutil.Process().memory_info().rss
    measuring = Measuring(way, [(way.grids[-1], way.encodings[0])])
    measuring.set_reference(rest)
    for shift in (0, 1, 2):
        for _, flow in measuring.flows():
            flow(np.roll(rest, shift, axis=1))
    return float(psutil.Process().memory_info().rss - before) / 1e6
