"""Computes the force of a press again, from samples whose recorder did not have the rig's clock.

The rig chose the samples of a window by their original stamps. By corrected stamps, other samples belong to it. The
direction of the sensor's z axis follows from the force that the rig computed from its samples. Lateral forces and
torques also depend on the mounting, which a bag does not contain. They become unknown (NaN), because those of the
message are from another time.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, cast

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.collection.wrench import slope
from tactile_nodes.messages import stamp_ns, types

SAME_N = 1e-3
UNKNOWN = math.nan


class ForceSamples:
    """Samples since the last press: original stamps, corrected stamps, and the sensor's force along its z axis."""

    def __init__(self) -> None:
        self._samples: list[tuple[int, int, float]] = []

    def take(self, uncorrected_ns: int, corrected_ns: int, force_n: float) -> None:
        """Take one sample."""
        self._samples.append((uncorrected_ns, corrected_ns, force_n))

    def renewed(self, press: types.Press) -> types.Press:
        """The press with the force of its window by corrected stamps; NaN if the force cannot be known."""
        start_ns, end_ns = stamp_ns(press.window_start), stamp_ns(press.window_end)
        samples = np.array(self._samples, [('uncorrected_ns', np.int64), ('stamp_ns', np.int64), ('force_n', float)])
        force, stamps = samples['force_n'], samples['stamp_ns']
        as_stamped = _within(samples['uncorrected_ns'], start_ns, end_ns)
        inside = _within(stamps, start_ns, end_ns)
        sign = _sign(press, float(force[as_stamped].mean())) if as_stamped.any() else 0
        if not sign or not inside.any():
            return _with(press, UNKNOWN, UNKNOWN, UNKNOWN, int(inside.sum()))
        on_gel = sign * (force[inside] - press.tare.force.z)
        rate = -slope([int(each) for each in stamps[inside]], on_gel)  # rate of the pressing force, which is positive
        return _with(press, float(on_gel.mean()), float(on_gel.std()), rate, int(inside.sum()))

    def forget(self, end_ns: int) -> None:
        """Drop samples older than a window's end by both stamps."""
        self._samples = [each for each in self._samples if max(each[:2]) > end_ns - NS_PER_S]


def _within(stamps: np.ndarray, start_ns: int, end_ns: int) -> np.ndarray:
    return (stamps >= start_ns) & (stamps <= end_ns)


def _sign(press: types.Press, mean_n: float) -> int:
    """Sign of the force on the gel along z relative to the sensor's: 1, -1, or 0 if samples and message differ."""
    change, reported_n = mean_n - press.tare.force.z, press.wrench.force.z
    return next((sign for sign in (-1, 1) if abs(sign * change - reported_n) < SAME_N), 0)


def _with(press: types.Press, force_n: float, deviation_n: float, rate: float, samples: int) -> types.Press:
    fields = {field.name: getattr(press, field.name) for field in dataclasses.fields(cast('Any', press))}
    wrenches = {'wrench': _along_z(force_n), 'wrench_deviation': _along_z(deviation_n)}
    return types.Press(**{**fields, **wrenches, 'force_rate': rate, 'samples': samples})


def _along_z(force_n: float) -> types.Wrench:
    return types.Wrench(
        force=types.Vector3(x=UNKNOWN, y=UNKNOWN, z=force_n),
        torque=types.Vector3(x=UNKNOWN, y=UNKNOWN, z=UNKNOWN),
    )
