"""Errors of flow methods on images with known motion."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np

from benchmarks.flow.cases import Case
from benchmarks.harness.report import in_turn
from tactile_nodes.sensing.flow.methods import DisplacementField, FlowMethod

BELIEVED = 0.4
"""Patches with more confidence than this count as believed."""


@dataclass
class Errors:
    """Results of one method: error and truth by region and axis (px), which regions are believed, CPU times (ms)."""

    error: list[np.ndarray] = field(default_factory=list)
    truth: list[np.ndarray] = field(default_factory=list)
    believed: list[np.ndarray] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)

    def take(self, flow: FlowMethod, case: Case, regions: int) -> None:
        """Measure an image; dense motion is averaged over regions."""
        begun = time.process_time_ns()
        measured = flow.displacement(case.image)
        self.cpu_ms.append((time.process_time_ns() - begun) / 1e6)
        motion, confidence = by_region(measured, regions)
        truth, counts = case.truth(motion.shape[0])
        self.add(Errors([(motion - truth)[counts]], [truth[counts]], [confidence[counts] > BELIEVED]))

    def add(self, other: Errors) -> None:
        """Add the results of further images."""
        for name in ('error', 'truth', 'believed', 'cpu_ms'):
            getattr(self, name).extend(getattr(other, name))

    def along_motion(self, low_px: float = 0.0, high_px: float = math.inf) -> dict[str, float]:
        """Root mean square error, bias along the motion, and number of the regions with a motion in this range."""
        error, truth = np.concatenate(self.error), np.concatenate(self.truth)
        size = np.hypot(*truth.T)
        chosen = (size >= low_px) & (size < high_px)
        if not chosen.any():
            return {'rms_px': math.nan, 'bias_px': math.nan, 'regions': 0}
        along = (error * truth).sum(axis=1)[chosen] / np.maximum(size[chosen], 1e-9)
        return {'rms_px': _rms(error[chosen]), 'bias_px': float(along.mean()), 'regions': int(chosen.sum())}

    def by_belief(self) -> dict[str, float]:
        """RMS error, slope of measured over true motion, share of errors over 1 px; also of the believed regions."""
        error, truth, believed = (np.concatenate(each) for each in (self.error, self.truth, self.believed))
        size, far = np.square(truth).sum(), np.hypot(*error.T) > 1
        return {
            'rms_px': _rms(error),
            'slope': float(((error + truth) * truth).sum() / size) if size > 0 else math.nan,
            'believed_rms_px': _rms(error[believed]) if believed.any() else 0.0,
            'far_share': float(far.mean()),
            'believed_share': float(believed.mean()),
            'believed_far_share': float(far[believed].mean()) if believed.any() else 0.0,
            'cpu_ms': float(np.median(self.cpu_ms)),
        }


def errors_of(flows: Mapping[str, FlowMethod], cases: Iterable[Case], regions: int) -> dict[str, Errors]:
    """The errors of each method on the cases, in turn on every image."""
    found = {name: Errors() for name in flows}
    rest: np.ndarray | None = None
    for number, case in enumerate(cases):
        if case.rest is not rest:
            rest = case.rest
            for flow in flows.values():
                flow.set_reference(rest)
                flow.displacement(rest)
        for name in in_turn(list(flows), number):
            found[name].take(flows[name], case, regions)
    return found


def by_region(field: DisplacementField, regions: int) -> tuple[np.ndarray, np.ndarray]:
    """Motion and confidence by patch, or of a dense field by region; the confidence is 1 if the method has none."""
    motion = field.displacement_px
    if motion.shape[0] > regions:
        motion = cv2.resize(motion, (regions, regions), interpolation=cv2.INTER_AREA)
    confidence = field.confidence if field.confidence is not None else np.ones(motion.shape[:2], np.float32)
    return motion, confidence


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.square(error).mean()))
