"""The measurements of all methods on all frames, with their times."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from benchmarks.front.contenders import Contender, Measuring, Way
from benchmarks.front.frames import Frame
from benchmarks.harness.report import in_turn
from tactile_nodes.clock import perf_ns

Time = tuple[float, float]
"""CPU and wall time, ms."""


class Shelf:
    """The measurements of all methods on all frames, with their times.

    All are by method, grid and encoding; `times_ms` (CPU, wall) is of flow and features together.
    """

    def __init__(self, ways: Sequence[Way], taking_part: Sequence[Contender]) -> None:
        keys = sorted({(each.way, each.regions, each.encoding) for each in taking_part})
        self.values: dict[tuple[str, int, str], list[np.ndarray]] = {key: [] for key in keys}
        self.confidence: dict[tuple[str, int, str], list[np.ndarray]] = {key: [] for key in keys}
        self.times_ms: dict[tuple[str, int, str], list[Time]] = {key: [] for key in keys}
        self.presses: list[tuple[float, float, float, float]] = []
        self._measuring = [Measuring(way, [key[1:] for key in keys if key[0] == way.name]) for way in ways]
        self._rest: np.ndarray | None = None

    def take(self, frame: Frame) -> None:
        """Measure one frame with all methods."""
        if frame.rest is not self._rest:
            self._rest = frame.rest
            for each in self._measuring:
                each.set_reference(frame.rest)
                for _, flow in each.flows():
                    flow(frame.rest)
        for each in in_turn(self._measuring, len(self.presses)):
            self._take(each, frame.image)
        self.presses.append(frame.press)

    def _take(self, measuring: Measuring, image: np.ndarray) -> None:
        for grid, flow in measuring.flows():
            begun = _now()
            measured = flow(image)
            flow_ms = _since(begun)
            for regions, encoding in measuring.wanted:
                if grid not in (0, regions):
                    continue
                begun = _now()
                features = measuring.encode(regions, encoding, measured)
                took = _since(begun)
                key = measuring.way.name, regions, encoding
                self.values[key].append(features.values.astype(np.float16))
                self.confidence[key].append(features.confidence)
                self.times_ms[key].append((flow_ms[0] + took[0], flow_ms[1] + took[1]))


def _now() -> tuple[int, int]:
    return time.process_time_ns(), perf_ns()


def _since(begun: tuple[int, int]) -> Time:
    cpu, wall = time.process_time_ns() - begun[0], perf_ns() - begun[1]
    return cpu / 1e6, wall / 1e6
