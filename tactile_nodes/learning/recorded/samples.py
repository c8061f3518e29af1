"""Samples as they are collected, and the arrays made from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_nodes.learning.datasets.labels import force_labels
from tactile_nodes.learning.datasets.recordings import (
    DEPTH_UNREPORTED,
    NEAR_BORDER,
    RETRIED,
    UNEVEN_FRAMES,
    RecordedPresses,
)
from tactile_nodes.learning.recorded.bags import Frame, RecordedPress
from tactile_nodes.learning.recorded.exclusions import force_n
from tactile_nodes.learning.recorded.feature_cache import Measured
from tactile_nodes.messages import types
from tactile_nodes.sensing.geometry import BinGrid

NEAR_BORDER_MM = 0.3
"""Within this distance of a border, the paper's tip (0.6 mm radius) touches both bins at any depth from 0.25 mm."""

_COLUMNS = {
    'contact': np.bool_, 'position_mm': np.float64, 'depth_mm': np.float64, 'depth_reported_mm': np.float64,
    'force_n': np.float64, 'force_rate_n_per_s': np.float64, 'wrench': np.float64, 'wrench_deviation': np.float64,
    'stamp_ns': np.int64, 'window_ns': np.int64, 'frames': np.int32, 'bag': np.int32, 'press': np.int64,
    'attempt': np.int32, 'quality': np.uint16, 'reference_id': np.str_, 'tare_id': np.str_,
}  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """One sample. Names and units are those of `RecordedPresses`."""

    features: np.ndarray
    confidence_row: int
    contact: bool
    position_mm: tuple[float, float]
    depth_mm: float
    depth_reported_mm: float
    force_n: float
    force_rate_n_per_s: float
    wrench: tuple[float, ...]
    wrench_deviation: tuple[float, ...]
    stamp_ns: int
    window_ns: tuple[int, int]
    frames: int
    bag: int
    plan: str
    press: int
    attempt: int
    indenter: str
    quality: int
    reference_id: str
    tare_id: str


class Shelf:
    """Makes samples. Data that many of them share is stored once."""

    def __init__(self, bins: BinGrid) -> None:
        self._bins = bins
        self._confidence: dict[bytes, tuple[int, np.ndarray]] = {}

    def sample(
        self,
        bag: int,
        press: RecordedPress,
        measured: Measured,
        frames: Sequence[Frame],
        reference: str,
        *,
        contact: bool,
    ) -> Sample:
        """The sample of some images of a press, or of the images without contact before it."""
        message = press.message
        x_mm, y_mm = round(message.position.x * 1e3, 6), round(message.position.y * 1e3, 6)
        unknown = (np.nan,) * 6
        row, _ = self._confidence.setdefault(
            measured.confidence.tobytes(), (len(self._confidence), measured.confidence)
        )
        return Sample(
            features=measured.values,
            confidence_row=row,
            contact=contact,
            position_mm=(x_mm, y_mm),
            depth_mm=round(message.depth * 1e3, 6) if contact else 0.0,
            depth_reported_mm=message.depth_reported * 1e3 if contact else np.nan,
            force_n=force_n(message) if contact else 0.0,
            force_rate_n_per_s=message.force_rate if contact else np.nan,
            wrench=_six(message.wrench) if contact else unknown,
            wrench_deviation=_six(message.wrench_deviation) if contact else unknown,
            stamp_ns=frames[0].stamp_ns,
            window_ns=press.window_ns if contact else (frames[0].stamp_ns, frames[-1].stamp_ns),
            frames=len(frames),
            bag=bag,
            plan=message.plan_id,
            press=message.press,
            attempt=message.attempt,
            indenter=message.indenter,
            quality=self._quality(press, (x_mm, y_mm)) if contact else 0,
            reference_id=reference,
            tare_id=message.tare_id,
        )

    def confidence(self, sample: Sample) -> np.ndarray:
        """The confidence of a sample's regions."""
        return list(self._confidence.values())[sample.confidence_row][1]

    def recordings(self, samples: Sequence[Sample], card: Mapping[str, Any]) -> RecordedPresses:
        """Samples as arrays. Confidences that no remaining sample uses are dropped."""
        columns: dict[str, Any] = {
            name: np.array([getattr(sample, name) for sample in samples], kind) for name, kind in _COLUMNS.items()
        }
        used, rows = np.unique([sample.confidence_row for sample in samples], return_inverse=True)
        confidence = [array for _, array in self._confidence.values()]
        names = {name: sorted({getattr(sample, name) for sample in samples}) for name in ('plan', 'indenter')}
        for name, known in names.items():
            columns[name] = np.array([known.index(getattr(sample, name)) for sample in samples], np.int32)
        return RecordedPresses(
            features=np.stack([sample.features for sample in samples]),
            labels=force_labels(columns['position_mm'], columns['force_n'], self._bins),
            confidence=np.stack([confidence[row] for row in used]),
            confidence_row=rows.reshape(-1).astype(np.int32),
            card={**card, 'plans': names['plan'], 'indenters': names['indenter']},
            **columns,
        )

    def _quality(self, press: RecordedPress, place: tuple[float, float]) -> int:
        gaps = np.diff([frame.stamp_ns for frame in press.frames])
        uneven = len(gaps) > 1 and gaps.max() > 1.5 * np.median(gaps)
        flags = {
            RETRIED: press.message.attempt > 1,
            NEAR_BORDER: self._bins.border_distance_mm(*place) < NEAR_BORDER_MM,
            DEPTH_UNREPORTED: not np.isfinite(press.message.depth_reported),
            UNEVEN_FRAMES: bool(uneven),
        }
        return sum(flag for flag, holds in flags.items() if holds)


def _six(wrench: types.Wrench) -> tuple[float, ...]:
    force, torque = wrench.force, wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z
