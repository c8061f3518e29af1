"""An hour of real time: monitors memory, files, threads and frames of a whole ``tactile launch live``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import psutil

from benchmarks.endurance.trend import MB, Look, growth
from benchmarks.gaps import Gaps
from benchmarks.harness.report import spread
from benchmarks.page.launch import Sensing, sensing
from tactile_nodes.clock import monotonic_s
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import types


@dataclass
class Frames(Gaps):
    """Statistics of the stream of forces.

    Attributes:
        received: number of forces.
        late_ms: delay from image to force, the 99th percentile between two looks.
        status: numbers of ok, degraded and invalid forces.
    """

    received: int = 0
    late_ms: list[float] = field(default_factory=list)
    status: dict[str, int] = field(default_factory=lambda: dict.fromkeys(('ok', 'degraded', 'invalid'), 0))


def live(seconds: float, every_s: float, progress: Progress) -> dict[str, Any]:
    """Start a launch and watch it.

    Raises:
        ConfigurationError: the launch does not start.
    """
    with sensing() as running:
        return watched(running, seconds, every_s, progress)


def watched(running: Sensing, seconds: float, every_s: float, progress: Progress) -> dict[str, Any]:
    """Watch a launch for `seconds`, and look at all its processes every `every_s`."""
    frames = Frames()
    loads: list[float] = []
    processes = {name: psutil.Process(pid) for name, pid in running.pids.items()}
    looks: dict[str, list[Look]] = {name: [] for name in processes}
    start_s = monotonic_s()
    with progress.bar('real time', round(seconds / every_s)) as bar:
        for number in range(round(seconds / every_s)):
            until_s = start_s + (number + 1) * every_s
            _listen(running, max(0.0, until_s - monotonic_s()), frames)
            for name, process in processes.items():
                looks[name].append(look(process, monotonic_s() - start_s))
            loads.append(os.getloadavg()[0])
            bar.advance(text=f'{frames.received} forces, {frames.skipped} images without one')
    return {
        'seconds': seconds, 'every_s': every_s, 'load': spread(loads), 'frames': asdict(frames),
        'processes': summed_up(looks),
    }  # fmt: skip


def look(process: psutil.Process, at_s: float) -> Look:
    """The present state of a process."""
    with process.oneshot():
        memory_mb = process.memory_info().rss / MB
        cpu = process.cpu_times()
        return Look(at_s, memory_mb, process.num_fds(), process.num_threads(), cpu.user + cpu.system)


def summed_up(looks: Mapping[str, list[Look]]) -> dict[str, Any]:
    """All looks at each process, with its growth."""
    return {name: {'looks': [asdict(each) for each in seen], **growth(seen)} for name, seen in looks.items() if seen}


def _listen(running: Sensing, seconds: float, frames: Frames) -> None:
    late_ms = []
    names = {value: name for name, value in zip(frames.status, _STATUS, strict=True)}
    for received in running.forces(seconds, fresh=not frames.begun):
        late_ms.append((received.source_ns - frames.take(received)) / 1e6)
        frames.received += 1
        frames.status[names[received.message.status]] += 1
    if late_ms:
        frames.late_ms.append(round(float(np.percentile(late_ms, 99)), 2))


_STATUS = (
    types.ForceDistribution.STATUS_OK,
    types.ForceDistribution.STATUS_DEGRADED,
    types.ForceDistribution.STATUS_INVALID,
)
