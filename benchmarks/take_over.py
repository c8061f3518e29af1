"""Evaluate the recording of a calibration: forces of the live node before and after, and lost frames.

Reads a bag that `tactile launch calibrate` recorded. The forces that the live node published with the model in use are
compared with those that the rig measured in the window of each press. A frame is lost if its features were published,
but no force with its stamp. Lost frames within a second of a take-over are counted separately.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.harness.declaration import Benchmark, Result, argument
from benchmarks.harness.running import Run
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import FLOW_FEATURES, FORCE_DISTRIBUTION, PRESS
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BagError
from tactile_nodes.messages import stamp_ns, types

BESIDE_NS = NS_PER_S


@dataclass(frozen=True)
class PublishedForce:
    """One published force: total in N, place in mm (NaN: no contact)."""

    stamp_ns: int
    model: str
    model_id: str
    total_n: float
    x_mm: float
    y_mm: float

    @classmethod
    def of(cls, message: types.ForceDistribution) -> PublishedForce:
        made, at = message.provenance, message.contact
        return cls(stamp_ns(message.header.stamp), made.model, made.model_id, message.total, 1e3 * at.x, 1e3 * at.y)


@dataclass
class Recording:
    """The messages of a recorded calibration, in the order of their stamps."""

    features_ns: list[int] = field(default_factory=list)
    forces: list[PublishedForce] = field(default_factory=list)
    presses: list[types.Press] = field(default_factory=list)

    @property
    def lost_ns(self) -> list[int]:
        """Stamps of the frames without a force, from the first force to the last."""
        known = {each.stamp_ns for each in self.forces}
        first, last = self.forces[0].stamp_ns, self.forces[-1].stamp_ns
        return [stamp for stamp in self.features_ns if stamp not in known and first < stamp < last]

    @property
    def taken_over_ns(self) -> list[int]:
        """Stamps of the first frame of each new model."""
        return [new.stamp_ns for old, new in pairwise(self.forces) if old.model_id != new.model_id]

    @property
    def lost_beside(self) -> int:
        """How many frames were lost within a second of a take-over."""
        taken = self.taken_over_ns
        return sum(any(abs(lost - each) <= BESIDE_NS for each in taken) for lost in self.lost_ns)


@dataclass(frozen=True)
class Row:
    """One model in live use: errors over the presses in its time; the force of a press is the median of its window."""

    model: str
    model_id: str
    frames: int
    presses: int
    rmse_n: float
    median_n: float
    place_mm: float


def read(bag: Path) -> Recording:
    """The live forces in a bag, and the rig's measurements.

    Raises:
        BagError: it cannot be read, or holds no forces.
    """
    found = Recording()
    with BagReader(bag) as reader:
        for message in reader.messages([f'/{topic.name}' for topic in (FLOW_FEATURES, FORCE_DISTRIBUTION, PRESS)]):
            decoded = reader.decode(message)
            if message.topic == f'/{PRESS.name}':
                found.presses.append(decoded)
            elif message.topic == f'/{FLOW_FEATURES.name}':
                found.features_ns.append(stamp_ns(decoded.header.stamp))
            else:
                found.forces.append(PublishedForce.of(decoded))
    if not found.forces:
        raise BagError(f'{bag} holds no forces; give a bag that tactile launch calibrate recorded, sensing included')
    found.forces.sort(key=lambda each: each.stamp_ns)
    return found


def rows(recording: Recording) -> list[Row]:
    """A row for each interval in which one model was in use."""
    spans = [recording.forces[0].stamp_ns, *recording.taken_over_ns, recording.forces[-1].stamp_ns + 1]
    found = []
    for start_ns, end_ns in pairwise(spans):
        forces = [each for each in recording.forces if start_ns <= each.stamp_ns < end_ns]
        errors = [error for press in recording.presses if (error := _error(press, forces)) is not None]
        found.append(_row(forces, errors))
    return found


def page(recording: Recording) -> str:
    """The table, and the number of lost frames."""
    lines = [
        '| model in use | frames | presses | force RMSE | force, median | place, median |',
        '|---|---|---|---|---|---|',
    ]
    for row in rows(recording):
        errors = f'{1e3 * row.rmse_n:.1f} mN | {1e3 * row.median_n:.1f} mN | {row.place_mm:.3f} mm'
        numbers = errors if row.presses else '– | – | –'
        lines.append(f'| {row.model} ({row.model_id}) | {row.frames} | {row.presses} | {numbers} |')
    taken, lost = len(recording.taken_over_ns), len(recording.lost_ns)
    lines += ['', f'{taken} take-overs; frames lost within a second of one: {recording.lost_beside}; else: '
              f'{lost - recording.lost_beside} of {len(recording.features_ns)}.']  # fmt: skip
    return '\n'.join(lines)


def _error(press: types.Press, forces: Iterable[PublishedForce]) -> tuple[float, float] | None:
    """Errors of force (N) and place (mm) of a press, from the live forces in its window; None without such forces."""
    start_ns, end_ns = stamp_ns(press.window_start), stamp_ns(press.window_end)
    seen = [each for each in forces if start_ns <= each.stamp_ns <= end_ns]
    if press.status != types.Press.STATUS_RECORDED or not seen:
        return None
    total, x_mm, y_mm = np.median([(each.total_n, each.x_mm, each.y_mm) for each in seen], axis=0).tolist()
    away_mm = math.hypot(x_mm - 1e3 * press.position.x, y_mm - 1e3 * press.position.y)
    return total + press.wrench.force.z, away_mm


def _row(forces: Sequence[PublishedForce], errors: Sequence[tuple[float, float]]) -> Row:
    off, away = np.array(errors).reshape(-1, 2).T
    numbers = (math.nan,) * 3
    if len(off):
        numbers = float(np.sqrt(np.mean(off**2))), float(np.median(np.abs(off))), float(np.nanmedian(away))
    return Row(forces[0].model, forces[0].model_id, len(forces), len(off), *numbers)


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Read the bag."""
    return {'_page': read(arguments.bag)}


BENCHMARK = Benchmark(
    name='take_over',
    about=__doc__,
    sources=('benchmarks/take_over.py', 'tactile_nodes/learning/calibrating/**', 'tactile_nodes/learning/transfer/**'),
    page=lambda result: page(result['_page']),
    measure=measured,
    files=('calibrate.md',),
    by_hand=True,
    keeps=False,
    arguments=(argument('bag', type=Path, help='a bag that tactile launch calibrate recorded'),),
)
