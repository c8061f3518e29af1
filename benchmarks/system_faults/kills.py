"""kill -9 of each process of live sensing during contact: time without forces, and errors afterwards."""

from __future__ import annotations

import http.client
import itertools
import os
import signal
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.system_faults.sensor import Seen, Sensor, sensor
from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import stamp_ns, types

INVALID = types.ForceDistribution.STATUS_INVALID
TOUCHED_N = 0.1
WATCH_S, LEAST_GAP_S = 20.0, 0.25


@dataclass(frozen=True)
class Victim:
    """A process to kill, the node that shows its return, and the arguments of its launch."""

    process: str
    node: str
    words: tuple[str, ...] = ('separate:=true',)


VICTIMS = (
    Victim('camera_node', '/camera'),
    Victim('flow_features_node', '/flow_features'),
    Victim('force_estimator_node', '/force_estimator'),
    Victim('drift_monitor_node', '/drift_monitor'),
    Victim('live_view_node', '/live_view'),
    Victim('recorder_node', '/recorder'),
    Victim('composed_node', '/force_estimator', ()),
)


@dataclass
class Kill:
    """The effect of a kill.

    Attributes:
        blind_s: time from the kill to the end of the longest gap without a valid force.
        missed: number of images in that gap, at 60 per second.
        back_s: time until the node was on the bus again; NaN: not during the observation.
        before_n, after_n: largest force error during contact, in the last second before the kill and in the rest of
            the same contact after it; NaN without contact.
        same_rest, same_model: whether rest image and model were the same as before; None: no force came.
        found: other results.
        load: load of the machine.
    """

    process: str
    blind_s: float = float('nan')
    missed: int = 0
    back_s: float = float('nan')
    before_n: float = float('nan')
    after_n: float = float('nan')
    same_rest: bool | None = None
    same_model: bool | None = None
    found: str = ''
    load: float = 0.0


@dataclass
class _Return:
    """Records when a node, and the page, is back."""

    running: Sensor
    victim: Victim
    killed_ns: int
    gone: bool = False
    back_s: float = float('nan')
    looked_ns: int = field(default=0)

    def look(self) -> None:
        now_ns = self.running.clock.now_ns()
        if now_ns - self.looked_ns < NS_PER_S // 20 or not np.isnan(self.back_s):
            return
        self.looked_ns = now_ns
        there = self.running.has(self.victim.node)
        self.gone = self.gone or not there
        if self.gone and there and (self.victim.process != 'live_view_node' or _serves(self.running.page)):
            self.back_s = (now_ns - self.killed_ns) / NS_PER_S


def kills(folder: Path, victims: Sequence[Victim], period_s: float, progress: Progress) -> list[dict[str, Any]]:
    """Kill each process in turn; processes with the same launch arguments share a launch."""
    found = []
    with progress.bar('kill -9', len(victims)) as bar:
        for number, words in enumerate(dict.fromkeys(victim.words for victim in victims)):
            with sensor(folder / f'launch{number}', period_s, *words) as running:
                running.set('/force_estimator', 'model', str(folder / f'launch{number}' / 'taken_over.safetensors'))
                running.call('/recorder/start')
                for victim in [each for each in victims if each.words == words]:
                    found.append(asdict(_kill(running, victim)))
                    bar.advance(text=f'{victim.process}: {found[-1]["blind_s"]:.2f} s')
    return found


def _kill(running: Sensor, victim: Victim) -> Kill:
    running.await_touch()
    before = running.watch(running.clock.now_ns() + NS_PER_S)
    running.launch.send(victim.process, signal.SIGKILL)
    killed_ns, touched_ns = running.clock.now_ns(), running.touches_until_ns
    noted = _Return(running, victim, killed_ns)
    after = running.watch(killed_ns + round(WATCH_S * NS_PER_S), noted.look)
    good = [each for each in after if each.status != INVALID and each.stamp_ns >= killed_ns]
    result = Kill(victim.process, back_s=noted.back_s, load=round(os.getloadavg()[0], 1))
    result.blind_s, result.missed = blindness(killed_ns, good)
    back_ns = killed_ns + result.blind_s * NS_PER_S
    same = [each for each in good if each.stamp_ns < touched_ns and each.published_ns >= back_ns - 1000]
    result.before_n, result.after_n = _worst(running, before), _worst(running, same)
    if before and good:
        result.same_rest = {each.reference_id for each in good} == {before[-1].reference_id}
        result.same_model = {each.model for each in good} == {before[-1].model}
    result.found = _recorded(running.bags) if victim.process == 'recorder_node' else ''
    return result


def blindness(killed_ns: int, good: Sequence[Seen]) -> tuple[float, int]:
    """Seconds from the kill to the end of the longest gap between forces, and the number of images in that gap.

    Forces published 0.1, 0.2 and 1.5 s after the kill give 1.5 s, and a gap of 1.3 s has 77 images between its ends.
    A gap of less than a quarter of a second does not count: 0 s.
    """
    if not good:
        return float('nan'), 0
    at_ns = np.array([killed_ns, *(each.published_ns for each in good)])
    longest = int(np.argmax(np.diff(at_ns)))
    gap_s = float(at_ns[longest + 1] - at_ns[longest]) / NS_PER_S
    back_s = float(at_ns[longest + 1] - killed_ns) / NS_PER_S if gap_s >= LEAST_GAP_S else 0.0
    return back_s, max(0, round(gap_s * 60) - 1)


def _worst(running: Sensor, seen: Sequence[Seen]) -> float:
    """The largest force error during contact [N]."""
    known = ((each, running.truths.get(each.stamp_ns, 0.0)) for each in seen)
    return max((abs(each.total_n - true_n) for each, true_n in known if true_n > TOUCHED_N), default=float('nan'))


def _recorded(folder: Path) -> str:
    """The content of the bags of a killed recorder, and the gap between them, as text."""
    ends = []
    for bag in sorted(folder.glob('rosbag2_*')):
        with BagReader(bag) as reader:
            stamps = [
                stamp_ns(reader.decode(message).header.stamp)
                for message in reader.messages([f'/{topics.FORCE_DISTRIBUTION.name}'])
            ]
        ends.append((len(stamps), min(stamps), max(stamps)))
    gaps_s = [(after[1] - before[2]) / NS_PER_S for before, after in itertools.pairwise(ends)]
    counts = ' and '.join(str(count) for count, _, _ in ends)
    return f'{len(ends)} bags with {counts} forces; between them {", ".join(f"{gap:.2f} s" for gap in gaps_s)}'


def _serves(address: str) -> bool:
    asked = http.client.HTTPConnection(address.removeprefix('http://').rstrip('/'), timeout=0.5)
    try:
        asked.request('GET', '/')
        return asked.getresponse().status == 200
    except (OSError, http.client.HTTPException):
        return False
    finally:
        asked.close()
