"""Zeroing on the host: the mean of unloaded samples, kept with the data, taken off what follows; raw stays raw.

The sensor's own bias command is not used: it changes the sensor for everybody, and the data do not show it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from tactile_nodes.clock import NS_PER_S
from tactile_nodes.drivers.force_torque.contract import Sample, Wrench
from tactile_nodes.errors import DeviceError

SHORTEST_S = 0.5
FEWEST = 4  # a converter of 10 samples a second has five in half a second


@dataclass(frozen=True)
class TareLimits:
    """How quiet the sensor must be.

    Attributes:
        drift_n: the mean force of the second half may differ by this much from that of the first.
        noise_n: standard deviation of the force on any axis.
    """

    drift_n: float = 0.05
    noise_n: float = 0.5


@dataclass(frozen=True)
class Tare:
    """What the sensor shows without load.

    Attributes:
        wrench: mean, in N and N·m.
        deviation: standard deviation on each axis; of the mean it is smaller by the root of `samples`.
        raw: mean of what the sensor sent, in its own units.
        samples: how many.
        start_ns, end_ns: stamps of the first and the last.
    """

    wrench: Wrench
    deviation: Wrench
    raw: tuple[float, ...]
    samples: int
    start_ns: int
    end_ns: int

    def record(self) -> dict[str, object]:
        """As plain values, for the record."""
        return asdict(self)


def tare(samples: Sequence[Sample], limits: TareLimits | None = None) -> Tare:
    """The tare from at least 0.5 s of samples without load.

    Raises:
        DeviceError: too few, some of them lost or not usable, or the sensor was not at rest; nothing is zeroed then.
    """
    limits = limits or TareLimits()
    _require_whole(samples)
    wrenches = np.array([sample.wrench for sample in samples])
    _require_rest(wrenches[:, :3], limits)
    mean, deviation = wrenches.mean(axis=0).tolist(), wrenches.std(axis=0).tolist()
    raw = np.array([sample.raw for sample in samples], dtype=float).mean(axis=0)
    return Tare(
        (mean[0], mean[1], mean[2], mean[3], mean[4], mean[5]),
        (deviation[0], deviation[1], deviation[2], deviation[3], deviation[4], deviation[5]),
        tuple(raw.tolist()),
        len(samples),
        samples[0].stamp_ns,
        samples[-1].stamp_ns,
    )


def _require_whole(samples: Sequence[Sample]) -> None:
    span_s = (samples[-1].stamp_ns - samples[0].stamp_ns) / NS_PER_S if samples else 0.0
    period_s = span_s / (len(samples) - 1) if len(samples) > 1 else 0.0
    if len(samples) < FEWEST or span_s + period_s < SHORTEST_S:
        raise DeviceError(
            f'cannot zero the force sensor: {len(samples)} samples over {span_s:.2f} s, {SHORTEST_S:g} s are needed'
        )
    if bad := sum(not sample.usable for sample in samples):
        raise DeviceError(f'cannot zero the force sensor: {bad} of {len(samples)} samples are faulty')
    if (lost := samples[-1].dropped - samples[0].dropped) > 0.1 * len(samples):
        raise DeviceError(f'cannot zero the force sensor: {lost} samples were lost meanwhile; check its line')


def _require_rest(forces: np.ndarray, limits: TareLimits) -> None:
    forces = forces[:, ~np.isnan(forces).all(axis=0)]
    if forces.size == 0:
        return
    half = len(forces) // 2
    drift = float(np.abs(forces[half:].mean(axis=0) - forces[:half].mean(axis=0)).max())
    noise = float(forces.std(axis=0).max())
    if not (drift <= limits.drift_n and noise <= limits.noise_n) or math.isnan(drift):
        raise DeviceError(
            f'cannot zero the force sensor: it is not at rest (force moved by {drift:.3f} N, noise {noise:.3f} N, '
            f'allowed are {limits.drift_n:g} and {limits.noise_n:g} N); lift the tip off, and wait'
        )
