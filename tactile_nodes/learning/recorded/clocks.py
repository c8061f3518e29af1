"""Fits the clock of each recorder in a bag to the rig's clock, by the edges of the line that all of them recorded.

Messages with the same frame as an edge were stamped by the same recorder's clock. For example, images with the frame of
the camera's edges have the camera's clock. A clock that agrees with the rig's to 2 ms is not corrected, so with equal
clocks the data set stays identical to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus.topics import RIG_STATE, SYNC_EDGE, Topic
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import DatasetError, MessageError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.sensing.sync.clocks import ClockFit, Refusal, SyncLimits, fit_clocks
from tactile_nodes.shapes import Bool, Float64, Int64

REFERENCE = 'rig'
"""The recorder whose clock is the reference if the bag holds no state of a machine to name it."""
AGREES_S = 0.002
LEAST_JITTER_S, MOST_JITTER_S = 0.005, 0.03


@dataclass(frozen=True)
class Edges:
    """The edges seen by one recorder, in order of stamps. A half width of 0 s means unknown."""

    stamp_ns: Int64[np.ndarray, ' n']
    level: Bool[np.ndarray, ' n']
    uncertainty_s: Float64[np.ndarray, ' n']

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def known_s(self) -> Float64[np.ndarray, ' n'] | None:
        """The half widths, if all are known."""
        return self.uncertainty_s if len(self) and bool((self.uncertainty_s > 0).all()) else None


@dataclass(frozen=True)
class Clock:
    """One recorder's clock against the reference.

    Attributes:
        recorder: the frame of its edges, and of all messages that it stamps.
        edges: the edges that it saw.
        outcome: the fit, or why there is none.
        furthest_s: the largest difference between the two clocks over the recorder's edges; 0 without a fit.
    """

    recorder: str
    edges: Edges
    outcome: ClockFit | Refusal
    furthest_s: float

    @property
    def corrects(self) -> bool:
        """Whether the fit changes stamps."""
        return isinstance(self.outcome, ClockFit) and self.furthest_s > AGREES_S

    def as_dict(self) -> dict[str, Any]:
        """For the card of a data set: numbers to the microsecond."""
        entry: dict[str, Any] = {'recorder': self.recorder, 'edges': len(self.edges), 'corrected': self.corrects}
        fit = self.outcome
        if isinstance(fit, Refusal):
            return {**entry, 'refused': fit.reason.value, 'why': fit.text}
        return {
            **entry,
            'offset_s': round(fit.offset_s, 6),
            'drift_ppm': round(fit.drift_ppm, 3),
            'matched': fit.inliers,
            'residual_median_s': round(fit.residual_median_s, 6),
            'residual_max_s': round(fit.residual_max_s, 6),
            'bound_s': round(fit.bound_s, 6),
        }


@dataclass(frozen=True)
class Clocks:
    """The recorders of a bag. `reference` names the reference recorder, `shared` holds its edges."""

    reference: str = REFERENCE
    shared: Edges = field(default_factory=lambda: _edges(()))
    others: tuple[Clock, ...] = ()

    def corrected_ns(self, stamp: int, frame_id: str) -> int:
        """The stamp of a message with this frame, on the reference's clock."""
        fit = self._correcting(frame_id)
        return stamp if fit is None else int(fit.host_ns(np.array([stamp], np.int64))[0])

    def corrects(self, frame_id: str) -> bool:
        """Whether stamps of this frame are changed."""
        return self._correcting(frame_id) is not None

    def error_ns(self, frame_id: str) -> int:
        """Largest error of a corrected stamp; 0 for stamps that are not corrected."""
        fit = self._correcting(frame_id)
        return 0 if fit is None else math.ceil(fit.bound_s * NS_PER_S)

    def _correcting(self, frame_id: str) -> ClockFit | None:
        for clock in self.others:
            if clock.recorder == frame_id and clock.corrects and isinstance(clock.outcome, ClockFit):
                return clock.outcome
        return None

    @property
    def warnings(self) -> list[str]:
        """A sentence for each recorder whose clock could not be fitted."""
        return [
            f'the clock of {clock.recorder} could not be compared with that of {self.reference}: {clock.outcome.text}'
            for clock in self.others
            if isinstance(clock.outcome, Refusal)
        ]

    def as_list(self) -> list[dict[str, Any]]:
        """For the card of a data set."""
        return [clock.as_dict() for clock in self.others]


def bag_clocks(reader: BagReader, namespace: str | None = None, reference: str | None = None) -> Clocks:
    """The clocks of a bag, by its edges.

    Args:
        reader: of the bag.
        namespace: of the sensor; None: all edges are of one sensor.
        reference: the recorder to fit to; None: the machine, by the frame of its states.

    Raises:
        DatasetError: the requested recorder has no edges in the bag.
    """
    edges_of = read_edges(reader, namespace)
    if not edges_of and reference is None:
        return Clocks()
    name = reference or first_frame(reader, topics_of(reader, RIG_STATE, namespace), REFERENCE)
    if reference is not None and reference not in edges_of:
        raise DatasetError(
            f'{reader.path} holds no edges of {reference!r}; recorders in it are: {", ".join(edges_of) or "none"}'
        )
    return fitted(edges_of, name)


def fitted(edges_of: Mapping[str, Edges], reference: str) -> Clocks:
    """The clock of every recorder against the clock of the reference."""
    shared = edges_of.get(reference, _edges(()))
    others = (_clock(name, edges, shared) for name, edges in sorted(edges_of.items()) if name != reference)
    return Clocks(reference, shared, tuple(others))


def read_edges(reader: BagReader, namespace: str | None = None) -> dict[str, Edges]:
    """The edges in a bag, by recorder."""
    found: dict[str, list[tuple[int, bool, float]]] = {}
    for message in reader.messages(topics_of(reader, SYNC_EDGE, namespace)):
        try:
            edge = reader.decode(message)
        except MessageError:
            continue  # counted where the bag is read as a whole
        row = stamp_ns(edge.header.stamp), bool(edge.level), float(edge.uncertainty)
        found.setdefault(edge.header.frame_id, []).append(row)
    return {name: _edges(sorted(edges)) for name, edges in found.items()}


def _clock(name: str, edges: Edges, shared: Edges) -> Clock:
    outcome = fit_clocks(
        edges.stamp_ns,
        shared.stamp_ns,
        _limits(edges, shared),
        edges.level,
        shared.level,
        edges.known_s,
        shared.known_s,
    )
    furthest_s = 0.0
    if isinstance(outcome, ClockFit):
        furthest_s = float(np.abs(outcome.host_ns(edges.stamp_ns) - edges.stamp_ns).max()) / NS_PER_S
    return Clock(name, edges, outcome, furthest_s)


def _limits(edges: Edges, shared: Edges) -> SyncLimits:
    """The limits of the fit: the half widths that recorders report, and a little more for what is unknown."""
    half_widths_s = [float(np.quantile(each.known_s, 0.9)) for each in (edges, shared) if each.known_s is not None]
    return SyncLimits(jitter_s=min(max(LEAST_JITTER_S, 1.5 * sum(half_widths_s)), MOST_JITTER_S))


def _edges(rows: Sequence[tuple[int, bool, float]]) -> Edges:
    return Edges(
        np.array([stamp for stamp, _, _ in rows], np.int64),
        np.array([level for _, level, _ in rows], bool),
        np.array([half for _, _, half in rows], np.float64),
    )


def first_frame(reader: BagReader, topics: list[str], default: str) -> str:
    """The frame of the first message of these topics that can be read."""
    for message in reader.messages(topics):
        try:
            return str(reader.decode(message).header.frame_id)
        except MessageError:
            continue
    return default


def topics_of(reader: BagReader, topic: Topic, namespace: str | None) -> list[str]:
    """The bag's topics of this name and type, in one namespace ('/': in none) or, with None, in all."""
    wanted = None if namespace is None else '/'.join(['', *filter(None, namespace.split('/')), topic.name])
    return sorted(
        name
        for name, described in reader.topics.items()
        if described.type_name == topic.type_name and name.rpartition('/')[2] == topic.name and wanted in (None, name)
    )
