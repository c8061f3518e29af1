"""Raw readings of the force/torque sensor, collected into messages: thousands of messages per second are too many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.drivers.force_torque.contract import Sample
from tactile_nodes.messages import types

SPAN_NS = 100_000_000


class Batch:
    """Samples of 0.1 s, counted from the first."""

    def __init__(self) -> None:
        self._samples: list[Sample] = []

    def add(self, sample: Sample) -> Sequence[Sample]:
        """Add a sample; returns the previous samples if it starts the next batch."""
        if self._samples and 0 <= sample.stamp_ns - self._samples[0].stamp_ns < SPAN_NS:
            self._samples.append(sample)
            return ()
        full, self._samples = self._samples, [sample]
        return full

    def rest(self) -> Sequence[Sample]:
        """The remaining samples."""
        full, self._samples = self._samples, []
        return full


def counts_message(samples: Sequence[Sample], frame_id: str, source: str) -> types.ForceTorqueCounts:
    """The samples of a batch, at least one."""
    start_ns = samples[0].stamp_ns
    return types.ForceTorqueCounts(
        header=conversions.header(start_ns, frame_id),
        source=source,
        measured=np.array([sample.stamp_ns - start_ns for sample in samples], np.uint32),
        arrived=np.array([sample.arrival_ns - start_ns for sample in samples], np.int64),
        sequence=np.array([sample.sequence for sample in samples], np.uint64),
        ticks=np.array([sample.device_ticks % (1 << 64) for sample in samples], np.uint64),
        status=np.array([sample.status for sample in samples], np.uint32),
        flags=np.array([sample.flags for sample in samples], np.uint16),
        channels=len(samples[0].raw),
        counts=np.array([sample.raw for sample in samples], np.float64).ravel(),
    )
