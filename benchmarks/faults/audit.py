"""Audits the files of a run: compares bags and journal with the plan, and both with the truth.

The truth is the trace of the emulated rig: the real position of the tip, independent of the drivers.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import PRESS, PRESS_IMAGE
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.plan.audit import bags_below
from tactile_nodes.collection.readings import frame_of, pattern_change
from tactile_nodes.errors import BagError
from tactile_nodes.messages import stamp_ns, types

DONE = {'recorded', 'verified', 'anchored'}
OFF_MM = 0.1
STILL_MM = 0.002
STILL_NS = 100_000_000
FAINT = 0.5
SUSPECT = 2
Attempt = tuple[int, int]


@dataclass(frozen=True)
class Ledger:
    """The state of the points of a plan. All but `points` hold numbers of presses.

    Attributes:
        points: number of points of the plan.
        lost: in no bag, but done according to the journal.
        left: not done according to the journal, so that a further launch would do them.
        doubled: in the bags more than once.
        wrong: recorded, but the tip was more than 0.1 mm away from its target.
        faint: the contrast of their images is less than half of the median.
    """

    points: int
    lost: tuple[int, ...]
    left: tuple[int, ...]
    doubled: tuple[int, ...]
    wrong: tuple[int, ...]
    faint: tuple[int, ...]


@dataclass(frozen=True)
class Stop:
    """The stop of the tip after a fault.

    Attributes:
        rest_s: time until it stopped or turned upwards.
        way_mm: how much deeper it went in that time.
        up_s: time until it was at the safe height; None if it never was in that launch.
        left_mm: its depth in the gel at the end of that launch, negative above the gel.
        force_n: the largest force from the fault on.
    """

    rest_s: float
    way_mm: float
    up_s: float | None
    left_mm: float
    force_n: float


class Trace:
    """The recorded positions of the tip."""

    def __init__(self, file: Path, gel_mm: Sequence[float]) -> None:
        lines = file.read_text(encoding='ascii').splitlines() if file.exists() else []
        entries = [entry for line in lines if (entry := _parsed(line)) is not None and 'tip' in entry]
        self.at_ns = np.array([entry['at'] for entry in entries], np.int64)
        self.tip_mm = np.array([entry['tip'] for entry in entries], float).reshape(-1, 3)
        self.force_n = np.array([entry['force'] for entry in entries], float)
        self._gel_mm = np.array(gel_mm, float)

    def place_mm(self, start_ns: int, end_ns: int) -> np.ndarray:
        """Mean x, y on the gel and depth in it over an interval; NaN without trace."""
        inside = (self.at_ns >= start_ns) & (self.at_ns <= end_ns)
        if not inside.any():
            return np.full(3, np.nan)
        place: np.ndarray = (self.tip_mm[inside].mean(axis=0) - self._gel_mm) * (1.0, 1.0, -1.0)
        return place

    def stop(self, fault_ns: int, end_ns: int, safe_mm: float) -> Stop | None:
        """The stop of the tip after a fault and before the end of the launch; None without trace."""
        inside = (self.at_ns >= fault_ns) & (self.at_ns <= end_ns)
        at_ns, z = self.at_ns[inside], self.tip_mm[inside, 2]
        if len(at_ns) < 2:
            return None
        last = _end_of_descent(at_ns, z)
        high = np.flatnonzero(z >= safe_mm - 0.02)
        return Stop(
            rest_s=float(at_ns[last] - fault_ns) / NS_PER_S,
            way_mm=float(z[0] - z[last]),
            up_s=float(at_ns[high[0]] - fault_ns) / NS_PER_S if len(high) else None,
            left_mm=float(self._gel_mm[2] - z[-1]),
            force_n=float(self.force_n[inside].max()),
        )


def _end_of_descent(at_ns: np.ndarray, z: np.ndarray) -> int:
    """Index of the first sample after which it goes no deeper for a tenth of a second."""
    for index in range(len(z)):
        soon = z[index : int(np.searchsorted(at_ns, at_ns[index] + STILL_NS)) + 1]
        if z[index] - soon.min() < STILL_MM:
            return index
    return len(z) - 1


def ledger(folder: Path, points: Sequence[Any], plan_id: str, trace: Trace) -> Ledger:
    """Audit a folder.

    Args:
        folder: folder of the journal and the bags.
        points: points of the plan.
        plan_id: name of the plan.
        trace: trace of all launches.
    """
    steps = journal_steps(folder / f'{plan_id}.jsonl')
    found = [press for bag in bags_below(folder) for press in _presses(bag, plan_id)]
    suspect = {press.key for press in found if press.status == SUSPECT}
    whole = [each for each in found if each.is_whole and each.key not in suspect]
    counted = Counter(each.key[0] for each in whole if (each.key, 'missing') not in steps.withdrawn)
    done = {press for press, step in steps.last.items() if step in DONE}
    faint_below = FAINT * float(np.median([each.contrast for each in whole])) if whole else 0.0
    return Ledger(
        points=len(points),
        lost=tuple(sorted(done - set(counted))),
        left=tuple(point.press for point in points if point.press not in done),
        doubled=tuple(sorted(press for press, count in counted.items() if count > 1)),
        wrong=tuple(sorted({each.key[0] for each in whole if not _was_there(each, points, trace)})),
        faint=tuple(sorted({each.key[0] for each in whole if each.contrast < faint_below})),
    )


@dataclass(frozen=True)
class Steps:
    """The content of a journal: the last step of each press, and the attempts withdrawn as missing."""

    last: dict[int, str]
    withdrawn: set[tuple[Attempt, str]]


def journal_steps(file: Path) -> Steps:
    """Read a journal without the project's own reader; a truncated line is ignored."""
    last: dict[int, str] = {}
    withdrawn = set()
    lines = file.read_text(encoding='ascii').splitlines()[1:] if file.exists() else []
    for entry in filter(None, map(_parsed, lines)):
        if entry['press'] > 0:
            last[entry['press']] = entry['step']
            if entry['step'] == 'missing':
                withdrawn.add(((entry['press'], entry['attempt']), 'missing'))
    return Steps(last, withdrawn)


@dataclass(frozen=True)
class _Pressed:
    key: Attempt
    status: int
    start_ns: int
    end_ns: int
    is_whole: bool
    contrast: float


def _presses(bag: Path, plan_id: str) -> list[_Pressed]:
    presses: list[types.Press] = []
    images: list[tuple[int, Any]] = []
    try:
        with BagReader(bag) as reader:
            names = [
                name for name in reader.metadata.topics if name.rpartition('/')[2] in {PRESS.name, PRESS_IMAGE.name}
            ]
            for message in reader.messages(names):
                if message.topic.endswith(PRESS_IMAGE.name):
                    images.append((message.publish_ns, conversions.image_array(reader.decode(message))))
                elif (press := reader.decode(message)).plan_id == plan_id and press.press > 0:
                    presses.append(press)
    except BagError:  # cut off before the first message
        return []
    images.sort(key=lambda image: image[0])
    return [_pressed(press, images) for press in presses]


def _pressed(press: types.Press, images: list[tuple[int, Any]]) -> _Pressed:
    start_ns, end_ns = stamp_ns(press.window_start), stamp_ns(press.window_end)
    inside = [(at_ns, image) for at_ns, image in images if start_ns <= at_ns <= end_ns]
    before = [(at_ns, image) for at_ns, image in images if at_ns < start_ns]
    contrast = 0.0
    if inside and before:
        contrast = pattern_change(frame_of(*before[-1]), frame_of(*inside[-1]))
    recorded = press.status == types.Press.STATUS_RECORDED and press.frames > 0
    is_whole = bool(recorded and len({at_ns for at_ns, _ in inside}) >= press.frames)
    return _Pressed((press.press, press.attempt), press.status, start_ns, end_ns, is_whole, contrast)


def _was_there(pressed: _Pressed, points: Sequence[Any], trace: Trace) -> bool:
    point = points[pressed.key[0] - 1]
    error = trace.place_mm(pressed.start_ns, pressed.end_ns) - (point.x_mm, point.y_mm, point.depth_mm)
    return bool(np.abs(error).max() <= OFF_MM)


def _parsed(line: str) -> Any:
    try:
        return json.loads(line)
    except ValueError:  # cut off
        return None
