"""Measurements of a run as messages."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.collection.plan.journal import Entry
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.press.surface import Surface
from tactile_nodes.drivers.cnc.contract import CncState, CncStatus, Switched
from tactile_nodes.drivers.force_torque.contract import Sample, Wrench
from tactile_nodes.messages import time_from_ns, types

STATES = {
    CncState.IDLE: types.RigState.STATE_IDLE,
    CncState.RUN: types.RigState.STATE_MOVING,
    CncState.JOG: types.RigState.STATE_MOVING,
    CncState.HOME: types.RigState.STATE_MOVING,
    CncState.HOLD: types.RigState.STATE_HOLDING,
    CncState.ALARM: types.RigState.STATE_ALARM,
}
UNKNOWN: Wrench = (math.nan,) * 6


def wrench_fields(wrench: Wrench) -> types.Wrench:
    """Six numbers as geometry_msgs/Wrench."""
    fx, fy, fz, tx, ty, tz = wrench
    return types.Wrench(force=types.Vector3(x=fx, y=fy, z=fz), torque=types.Vector3(x=tx, y=ty, z=tz))


def sample_message(sample: Sample, frame_id: str) -> types.WrenchStamped:
    """A force sample."""
    head = conversions.header(sample.stamp_ns, frame_id)
    return types.WrenchStamped(header=head, wrench=wrench_fields(sample.wrench))


def traffic_message(sent: bool, stamp_ns: int, data: bytes, port: str, frame_id: str) -> types.SerialTraffic:
    """Bytes that passed to or from the machine's controller."""
    head = conversions.header(stamp_ns, frame_id)
    return types.SerialTraffic(header=head, port=port, sent=sent, data=np.frombuffer(data, np.uint8))


def edge_message(switched: Switched, count: int, recorder: str, line: str) -> types.SyncEdge:
    """An edge of the digital line as the host saw it: between command and acknowledgement."""
    middle_ns = (switched.earliest_ns + switched.latest_ns) // 2
    return types.SyncEdge(
        header=conversions.header(middle_ns, recorder),
        line=line,
        level=switched.level,
        count=count,
        uncertainty=(switched.latest_ns - switched.earliest_ns) / 2e9,
    )


def state_message(
    status: CncStatus, press: int, surface: Surface | None, gel_mm: tuple[float, float], words: str, frame_id: str
) -> types.RigState:
    """The state of the machine."""
    x, y, z = status.position_mm
    depth = math.nan if surface is None else surface.depth_mm(x - gel_mm[0], y - gel_mm[1], z)
    return types.RigState(
        header=conversions.header(status.stamp_ns, frame_id),
        state=STATES.get(status.state, types.RigState.STATE_UNKNOWN) if status.homed else types.RigState.STATE_UNKNOWN,
        homed=status.homed,
        position=types.Point(x=x / 1000, y=y / 1000, z=z / 1000),
        depth=depth / 1000,
        press=press,
        controller=words,
    )


def press_message(record: Record, plan_id: str, indenter: str, frame_id: str) -> types.Press:
    """An attempt at a press."""
    point, tare = record.point, record.tare
    return types.Press(
        header=conversions.header(record.start_ns, frame_id),
        plan_id=plan_id,
        press=point.press,
        attempt=record.attempt,
        position=types.Point(x=point.x_mm / 1000, y=point.y_mm / 1000, z=0.0),
        depth=point.depth_mm / 1000,
        depth_reported=record.depth_reported_mm / 1000,
        indenter=indenter,
        window_start=time_from_ns(record.start_ns),
        window_end=time_from_ns(record.end_ns),
        frames=len(record.frames),
        samples=record.samples,
        wrench=wrench_fields(record.wrench),
        wrench_deviation=wrench_fields(record.deviation),
        tare=wrench_fields(tare.wrench if tare is not None else UNKNOWN),
        tare_id=tare.tare_id if tare is not None else '',
        force_rate=record.force_rate,
        status=types.Press.STATUS_REJECTED if record.reason else types.Press.STATUS_RECORDED,
        reason=record.reason,
    )


def suspect_message(entry: Entry, plan_id: str, reason: str, now_ns: int, frame_id: str) -> types.Press:
    """A recorded attempt no longer counts."""
    return types.Press(
        header=conversions.header(now_ns, frame_id),
        plan_id=plan_id,
        press=entry.press,
        attempt=entry.attempt,
        status=types.Press.STATUS_SUSPECT,
        reason=reason,
    )


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
