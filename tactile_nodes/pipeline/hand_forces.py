"""Sums the forces of a hand's sensors that were captured together. It reads no clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.sensing.grasp import grasp_margin, moved_wrench, wrench_mover
from tactile_nodes.sensors import Hand, HandSensor

PATIENCE = 3
"""Frames by which one sensor may lag another, live: on a busy machine forces are one or two frames late."""
REPLAYED = 600
"""The same in a replay, where one sensor may run ahead: ten seconds at 60 frames a second."""
_UNKNOWN = types.Vector3(x=math.nan, y=math.nan, z=math.nan)


class HandForces:
    """Sums forces that were captured within one frame time. A sum waits for late sensors.

    If a sensor is silent while another is more than `patience` frames ahead, sums no longer wait for it until it
    publishes again. So the sums do not depend on which sensor is ahead. `last_ns` are the stamps of each sensor's last
    image in a recording: no sum waits for a sensor whose recording has ended or is empty.
    """

    def __init__(self, hand: Hand, patience: int = PATIENCE, last_ns: Mapping[str, int] | None = None) -> None:
        self._hand = hand
        self._movers = {each.name: wrench_mover(each.frame.parent_from_surface) for each in hand.sensors}
        self._patience = patience
        self._last_ns = None if last_ns is None else {name: last_ns.get(name, 0) for name in hand.names}
        self._frame_ns = round(NS_PER_S / hand.fps)
        self._waiting: dict[str, deque[types.ForceDistribution]] = {name: deque() for name in hand.names}
        self._silent = {name for name in hand.names if self._has_ended(name, 0)}
        self._newest_ns = -1
        self._together: Collection[str] = ()
        self._latest_ns: dict[str, int] = {}

    def add(self, name: str, force: types.ForceDistribution) -> list[types.HandWrench]:
        """Add a force of the sensor `name`; returns the sums that are now complete, mostly one or none."""
        at_ns = stamp_ns(force.header.stamp)
        if at_ns < self._latest_ns.get(name, at_ns) - NS_PER_S:  # a recording began again
            self._waiting[name].clear()
            self._newest_ns = min(self._newest_ns, at_ns - 1)
        self._latest_ns[name] = at_ns
        self._silent.discard(name)
        if self._has_ended(name, at_ns):
            self._silent.add(name)
        if at_ns > self._newest_ns - self._frame_ns * (name in self._together):  # else its time was summed without it
            self._waiting[name].append(force)
        due = []
        while self._is_due():
            due += self._sums()
        return due

    def _has_ended(self, name: str, at_ns: int) -> bool:
        """Whether the recording of a sensor ends with the image of that stamp."""
        return self._last_ns is not None and at_ns >= self._last_ns[name]

    def _is_due(self) -> bool:
        longest = max(map(len, self._waiting.values()))
        lacking = {name for name, forces in self._waiting.items() if not forces} - self._silent
        if lacking and longest > self._patience:
            self._silent |= lacking
            return True
        return longest > 0 and not lacking

    def _sums(self) -> list[types.HandWrench]:
        """The next sum; none of forces that are older than the last one, whose stamps would step back."""
        first = {name: stamp_ns(each[0].header.stamp) for name, each in self._waiting.items() if each}
        together = {name: at_ns for name, at_ns in first.items() if at_ns <= min(first.values()) + self._frame_ns}
        forces = {name: self._waiting[name].popleft() for name in together}
        if (newest_ns := max(together.values())) <= self._newest_ns:
            return []
        self._newest_ns, self._together = newest_ns, together
        return [summed(self._hand, self._movers, forces, newest_ns)]


def summed(
    hand: Hand, movers: Mapping[str, np.ndarray], forces: dict[str, types.ForceDistribution], at_ns: int
) -> types.HandWrench:
    """The sum of the forces of a hand's sensors, by name. Errors of different sensors count as independent.

    `movers` are the 6 by 6 matrices from each surface to the hand.
    """
    wrenches = {name: _in_hand(movers[name], forces[name]) for name in hand.names if _is_known(forces.get(name))}
    margins = [
        margin
        for each in hand.sensors
        if (force := forces.get(each.name)) is not None and force.status != force.STATUS_INVALID
        for margin in _margins(each, force, hand.friction)
    ]
    head = conversions.header(at_ns, hand.frame)
    missing = [name for name in hand.names if name not in wrenches]
    margins.sort(key=_order)
    if not wrenches:
        return types.HandWrench(
            header=head, wrench=types.Wrench(force=_UNKNOWN, torque=_UNKNOWN),
            wrench_covariance=np.array([-1.0] + 35 * [0.0]), missing=missing, margins=margins,
        )  # fmt: skip
    wrench, covariance = (sum(parts[1:], parts[0]) for parts in zip(*wrenches.values(), strict=True))
    return types.HandWrench(
        header=head, wrench=_wrench(wrench), wrench_covariance=covariance.reshape(-1), sensors=list(wrenches),
        missing=missing, margins=margins,
    )  # fmt: skip


def _is_known(force: Any) -> bool:
    return force is not None and force.status != force.STATUS_INVALID and bool(force.wrench_covariance[0] >= 0)


def _in_hand(mover: np.ndarray, force: types.ForceDistribution) -> tuple[np.ndarray, np.ndarray]:
    pull, turn = force.wrench.force, force.wrench.torque
    wrench = np.array([pull.x, pull.y, pull.z, turn.x, turn.y, turn.z])
    covariance = np.asarray(force.wrench_covariance, float).reshape(6, 6)
    return moved_wrench(mover, wrench, covariance)


def _wrench(found: np.ndarray) -> types.Wrench:
    fx, fy, fz, tx, ty, tz = map(float, found)
    return types.Wrench(force=types.Vector3(x=fx, y=fy, z=fz), torque=types.Vector3(x=tx, y=ty, z=tz))


def _margins(sensor: HandSensor, force: types.ForceDistribution, friction: float) -> list[types.GraspMargin]:
    messages = []
    for each in force.contacts:
        shear, shear_sigma = _shear(each, force)
        margin, sigma = grasp_margin(each.force, each.force_sigma, shear, shear_sigma, friction)
        x, y, z = sensor.frame.parent_from_surface[:3] @ (each.position.x, each.position.y, each.position.z, 1.0)
        margin_message = types.GraspMargin(
            sensor=sensor.name, position=types.Point(x=float(x), y=float(y), z=float(z)), normal=each.force,
            shear=shear, margin=margin, margin_sigma=sigma, slip_share=each.slip_share,
        )  # fmt: skip
        messages.append(margin_message)
    return messages


def _shear(contact: types.Contact, force: types.ForceDistribution) -> tuple[float, float]:
    """The shear force of a contact and its standard deviation; zero for a contact read as the normal press of a tip.

    The standard deviation then comes from the wrench: no contact bears more shear than all of them together.
    """
    if math.isnan(contact.shear_x) and force.explanation == force.EXPLANATION_TIPS and force.wrench_covariance[0] >= 0:
        return 0.0, math.sqrt(max(float(force.wrench_covariance[0]), float(force.wrench_covariance[7])))
    return math.hypot(contact.shear_x, contact.shear_y), contact.shear_sigma


def _order(margin: types.GraspMargin) -> tuple[float, float]:
    """Sort key: the least margin first; if no margin is known, the largest share that already slips."""
    unknown = math.isnan(margin.margin)
    slips = 0.0 if math.isnan(margin.slip_share) else margin.slip_share
    return (math.inf if unknown else margin.margin, -slips)
