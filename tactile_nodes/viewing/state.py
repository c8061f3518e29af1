"""The state of a view. It is fed with received messages and asked for snapshots; it reads no clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from tactile_nodes.bus.node.diagnostics import ENDED
from tactile_nodes.bus.protocol import Received
from tactile_nodes.errors import MessageError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.viewing.gaps import SequenceGaps
from tactile_nodes.viewing.measures import (
    NS_PER_S,
    STAGES,
    Comparison,
    Histogram,
    Pair,
    Percentiles,
    Recent,
    Scores,
    StampGaps,
    stage_times,
)

WINDOW_S = 5.0
OLD_S = 1.0  # a value that came longer ago is not shown as current
SILENT_AFTER_S = 3.5  # nodes report once a second
EARLIER_S = 10.0  # a node that was silent so long before the forces ended is not the cause
_WARN = 30
_ERROR = 2  # of a DiagnosticStatus
_LOG_LEVELS = {30: 'WARN', 40: 'ERROR', 50: 'FATAL'}


@dataclass(frozen=True)
class NodeHealth:
    """The worst status that one node reports of its parts."""

    node: str
    level: int
    text: str
    age_s: float


@dataclass(frozen=True)
class Snapshot:
    """What to show at one instant.

    `force` and `truth` belong together: when a true force exists, they are the last two of the same stamp.
    `lost` counts forces that were published but not received here; `skipped`, frames without a published force. For a
    hand it holds the snapshots of its `sensors`, and the total force on them, unless that is old.
    """

    namespace: str
    running_s: float
    frames: int
    force: Any
    truth: Any
    age_s: float
    arrivals_hz: float
    stamps_hz: float
    latencies: Mapping[str, Percentiles]
    lost: int
    skipped: int
    malformed: int
    invalid: int
    scores: Scores
    health: tuple[NodeHealth, ...]
    logs: tuple[str, ...]
    estimators: tuple[str, ...]
    advice: str
    first_after_s: float
    sensors: tuple[Snapshot, ...] = ()
    wrench: Any = None

    @property
    def pair(self) -> Pair | None:
        return Pair(0, self.force, self.truth) if self.truth is not None else None


class ViewState:
    """Gets `Received` messages; `now_ns` is on the host's time base, like their times."""

    def __init__(self, namespace: str = '/', start_ns: int = 0) -> None:
        self.namespace = namespace
        self.malformed = 0
        self.estimators: tuple[str, ...] = ()
        self.advice = 'start a sensor with: tactile launch live'
        self.sensors: dict[str, ViewState] = {}
        self._wrench: Any = None
        self._wrench_ns = 0
        self._health: dict[str, _NodeHealth] = {}
        self._logs: deque[_LogLine] = deque(maxlen=4)
        self._start_ns = start_ns
        self.frames = self._invalid = 0
        self._force: Any = None
        self._arrival_ns = 0
        self._first_ns: int | None = None
        self._last_ns = 0
        self._recent = Recent(WINDOW_S)
        self._overall = [Histogram() for _ in STAGES]
        self._lost = SequenceGaps()
        self._skipped = StampGaps()
        self._comparison = Comparison()
        self._truth_ns = -math.inf

    def add_force(self, received: Received) -> None:
        """Add a force distribution.

        Raises:
            MessageError: its bins do not fill its grid.
        """
        message = checked(received.message)
        captured_ns = stamp_ns(message.header.stamp)
        times = stage_times(message.stages, (received.received_ns - captured_ns) / NS_PER_S)
        self.frames += 1
        self._invalid += message.status == message.STATUS_INVALID
        self._force, self._arrival_ns = message, received.received_ns
        self._lost.add(received.publisher, received.sequence)
        self._skipped.add(captured_ns, received.received_ns)
        self._recent.add(received.received_ns, captured_ns, times)
        for histogram, seconds in zip(self._overall, times, strict=True):
            histogram.add(seconds)
        self._comparison.add_force(captured_ns, message)
        if self._first_ns is None:
            self._first_ns = received.received_ns
        self._last_ns = received.received_ns

    def add_truth(self, received: Received) -> None:
        """Add a true force distribution.

        Raises:
            MessageError: its bins do not fill its grid.
        """
        message = checked(received.message)
        self._truth_ns = received.received_ns
        self._comparison.add_truth(stamp_ns(message.header.stamp), message)

    def add_sensor(self, namespace: str, now_ns: int) -> ViewState:
        """One sensor of a hand, to be fed with its forces."""
        return self.sensors.setdefault(namespace, ViewState(namespace, now_ns))

    def add_wrench(self, received: Received) -> None:
        self._wrench, self._wrench_ns = received.message, received.received_ns

    def add_diagnostics(self, received: Received) -> None:
        for status in received.message.status:
            node, _, part = status.name.partition(': ')
            if self._is_ours(node.replace('.', '/')):
                if (part, status.message) == ('node', ENDED):
                    self._health.pop(f'/{node.lstrip("/")}', None)
                    continue
                node_health = self._health.setdefault(f'/{node.lstrip("/")}', _NodeHealth())
                node_health.time_ns = received.received_ns
                node_health.parts[part] = (_level(status.level), _printable(status.message), received.received_ns)

    def add_log(self, received: Received) -> None:
        """Add a log message of a node; warnings and worse are kept."""
        message = received.message
        if message.level < _WARN or not self._is_ours(message.name.replace('.', '/')):
            return
        self.add_note(f'[{_LOG_LEVELS.get(message.level, message.level)}] [{message.name}]: {message.msg}')

    def add_note(self, text: str) -> None:
        """Add a text for a person; from any thread."""
        text = _printable(text)
        if self._logs and self._logs[-1].text == text:
            self._logs[-1].times += 1
        else:
            self._logs.append(_LogLine(text))

    def force_within(self, now_ns: int, seconds: float) -> Any:
        """The last ForceDistribution if it arrived in the last `seconds`, else None; from any thread."""
        force, arrival_ns = self._force, self._arrival_ns
        return force if now_ns - arrival_ns < seconds * NS_PER_S else None

    def current(self, now_ns: int) -> Snapshot:
        """What to show now, without rates and latencies, which are expensive to compute."""
        return self._picture(now_ns, (math.nan, math.nan), {})

    def snapshot(self, now_ns: int) -> Snapshot:
        """What to show now; rates and latencies are those of the last `WINDOW_S` seconds."""
        self._recent.forget(now_ns)
        sensors = tuple(each.snapshot(now_ns) for each in self._hand())
        return self._picture(now_ns, self._recent.rates_hz(), self._recent.percentiles(), sensors)

    def summary(self, now_ns: int) -> Snapshot:
        """As `snapshot`, with rates and latencies of the whole time; latencies are accurate to half a percent."""
        latencies = {stage: found.percentiles() for stage, found in zip(STAGES, self._overall, strict=True)}
        sensors = tuple(each.summary(now_ns) for each in self._hand())
        return self._picture(now_ns, self._overall_hz(), latencies, sensors)

    def _hand(self) -> Iterable[ViewState]:
        """The sensors to show together: none once a force of the namespace itself has come."""
        return () if self.frames else self.sensors.values()

    def _picture(
        self,
        now_ns: int,
        rates_hz: tuple[float, float],
        latencies: Mapping[str, Percentiles],
        sensors: tuple[Snapshot, ...] = (),
    ) -> Snapshot:
        force, truth = self._shown()
        return Snapshot(
            namespace=self.namespace,
            running_s=(now_ns - self._start_ns) / NS_PER_S,
            frames=self.frames,
            force=force,
            truth=truth,
            age_s=(now_ns - self._arrival_ns) / NS_PER_S if self.frames else math.nan,
            arrivals_hz=rates_hz[0],
            stamps_hz=rates_hz[1],
            latencies=latencies,
            lost=self._lost.total,
            skipped=self._skipped.total,
            malformed=self.malformed,
            invalid=self._invalid,
            scores=self._comparison.scores(),
            health=tuple(node_health.health(node, now_ns) for node, node_health in sorted(self._health.items())),
            logs=tuple(str(line) for line in self._logs),
            estimators=self.estimators,
            advice=self.advice,
            first_after_s=math.nan if self._first_ns is None else (self._first_ns - self._start_ns) / NS_PER_S,
            sensors=sensors,
            wrench=self._wrench if now_ns - self._wrench_ns <= OLD_S * NS_PER_S else None,
        )

    def _shown(self) -> tuple[Any, Any]:
        """The last pair while there are true forces; else the last force alone."""
        pair = self._comparison.last
        if pair is not None and self._arrival_ns - self._truth_ns < NS_PER_S:
            return pair.force, pair.truth
        return self._force, None

    def _overall_hz(self) -> tuple[float, float]:
        if self._first_ns is None or self.frames < 2:
            return math.nan, math.nan
        span_s = (self._last_ns - self._first_ns) / NS_PER_S
        return (self.frames - 1) / span_s if span_s > 0 else math.nan, self._skipped.rate_hz

    def _is_ours(self, node: str) -> bool:
        return f'/{node.lstrip("/")}'.startswith(f'{self.namespace.rstrip("/")}/')


class _NodeHealth:
    """What a node reported about each of its parts, and when.

    Parts that it no longer reports do not count: it was restarted, and does not know its earlier errors.
    """

    def __init__(self) -> None:
        self.time_ns = 0
        self.parts: dict[str, tuple[int, str, int]] = {}

    def health(self, node: str, now_ns: int) -> NodeHealth:
        since_ns = self.time_ns - SILENT_AFTER_S * NS_PER_S
        parts = {part: (level, text) for part, (level, text, at_ns) in self.parts.items() if at_ns >= since_ns}
        level = max((found for found, _ in parts.values()), default=0)
        texts = [f'{part}: {text}' for part, (found, text) in parts.items() if found == level and text]
        return NodeHealth(node, level, '; '.join(texts), (now_ns - self.time_ns) / NS_PER_S)


class _LogLine:
    """A line of the log, and how often it was repeated in a row."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.times = 1

    def __str__(self) -> str:
        return self.text if self.times == 1 else f'{self.text} (x{self.times})'


def reason_names(reasons: int) -> list[str]:
    """Short names of the bits of ForceDistribution.reasons.

    >>> reason_names(types.ForceDistribution.REASON_DARK_IMAGE | types.ForceDistribution.REASON_STALE)
    ['dark image', 'stale']
    """
    prefix = 'REASON_'
    bits = {name: bit for name, bit in vars(types.ForceDistribution).items() if name.startswith(prefix)}
    return [name.removeprefix(prefix).lower().replace('_', ' ') for name, bit in bits.items() if reasons & bit]


def complaint(shot: Snapshot) -> str:
    """The worst report of a node, with its name; empty if all is fine.

    A node that was silent long before the forces ended, such as a recorder, is not the cause.
    """
    concerned = [entry for entry in shot.health if not entry.age_s > shot.age_s + EARLIER_S]
    bad = [entry for entry in concerned if 0 < entry.level <= _ERROR]
    worst = max(bad, key=lambda entry: entry.level, default=None)
    return f'{worst.node}: {worst.text}' if worst else ''


def silent(health: Iterable[NodeHealth]) -> list[NodeHealth]:
    """The nodes that have not reported their status for some time."""
    return [entry for entry in health if entry.age_s > SILENT_AFTER_S]


def checked(message: Any) -> Any:
    """The ForceDistribution. Raises MessageError: its bins do not fill its grid."""
    bins = message.normal_force.size
    if not bins or bins != message.rows * message.cols:
        raise MessageError(f'a force distribution has {bins} bins, but a grid of {message.rows} x {message.cols}')
    return message


def _printable(text: str) -> str:
    """The text on one line, without terminal control characters."""
    return ''.join(letter if letter.isprintable() else ' ' for letter in text)


def _level(level: Any) -> int:
    """The level as a number; rclpy's nodes send it as a byte."""
    return level[0] if isinstance(level, bytes) else int(level)
