"""From sensor readings to the force on the gel: tare, rotation, reference point of the torque, means over a window.

Frames: the sensor's own; the machine's (z up); the gel's surface frame, whose axes are the machine's and whose origin
is the centre of the surface. The sensor measures what the gel does to the tip. The label is the opposite, so a tip that
presses straight down has a negative force z on the gel.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactile_nodes.collection.settings import MountingSettings
from tactile_nodes.drivers.force_torque.contract import Sample, Wrench
from tactile_nodes.errors import DeviceTimeoutError

Array = npt.NDArray[np.float64]
NS_PER_S = 1e9
NOISE_SIGMAS = 4.0


@dataclass(frozen=True)
class Tare:
    """Reading of an unloaded sensor: mean and standard deviation in its own axes, number of samples, end time."""

    wrench: Wrench
    deviation: Wrench
    samples: int
    stamp_ns: int

    @property
    def tare_id(self) -> str:
        """Identifies these numbers: 12 hexadecimal digits of a SHA-256."""
        return hashlib.sha256(repr((self.wrench, self.stamp_ns)).encode('ascii')).hexdigest()[:12]

    @property
    def noise_n(self) -> float:
        """Standard deviation of the force along z in N."""
        return self.deviation[2]


def tare_of(samples: Sequence[Sample]) -> Tare:
    """The tare from the samples; an axis that is not measured stays NaN.

    Raises:
        DeviceTimeoutError: there is no sample.
    """
    if not samples:
        raise DeviceTimeoutError('no force samples for the tare; check the force/torque sensor')
    table = wrenches(samples)
    return Tare(as_wrench(table.mean(axis=0)), as_wrench(table.std(axis=0)), len(samples), samples[-1].stamp_ns)


def wrenches(samples: Sequence[Sample]) -> Array:
    """(n, 6), in the sensor's axes."""
    return np.array([sample.wrench for sample in samples], np.float64).reshape(-1, 6)


def as_wrench(values: Array) -> Wrench:
    """Six numbers as a wrench."""
    fx, fy, fz, tx, ty, tz = (float(value) for value in values)
    return (fx, fy, fz, tx, ty, tz)


def machine_from_sensor(mounting: MountingSettings) -> Array:
    """The rotation (3, 3). Turned by 90° and upright, (1, 0, 0) of the sensor is (0, 1, 0) of the machine."""
    angle = math.radians(mounting.turn_deg)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ np.diag([1.0, -1.0, -1.0]) if mounting.upside_down else turn


def _rotated(rotation: Array, vectors: Array) -> Array:
    """Like `vectors @ rotation.T`, but the NaN of an axis that is not measured affects only components that need it."""
    terms = np.where(rotation == 0.0, 0.0, vectors[:, None, :] * rotation)
    return np.asarray(np.where(rotation == 0.0, 0.0, terms).sum(axis=2))


def on_gel(table: Array, tare: Tare, mounting: MountingSettings, tip_mm: tuple[float, float, float]) -> Array:
    """The wrench on the gel, in its surface frame, about the centre of its surface.

    Args:
        table: (n, 6), readings of the sensor.
        tare: to subtract.
        mounting: of the sensor.
        tip_mm: the tip in the surface frame; below the surface z is negative.

    Returns:
        (n, 6) in N and N·m. An upright sensor that reads (0, 0, 1) N more than its tare, with the tip at
        (10, 0, -1) mm: force (0, 0, -1) N, torque (0, 0.01, 0) N·m.
    """
    rotation = machine_from_sensor(mounting)
    change = table - np.array(tare.wrench)
    force, torque = _rotated(rotation, change[:, :3]), _rotated(rotation, change[:, 3:])
    arm_m = np.array([tip_mm[0], tip_mm[1], tip_mm[2] + mounting.tool_mm]) / 1000
    return np.asarray(-np.hstack([force, torque + np.cross(np.broadcast_to(arm_m, force.shape), force)]))


def pressing_n(table: Array, tare: Tare, mounting: MountingSettings) -> Array:
    """Force into the gel in N, (n,): positive is pressing."""
    rotation = machine_from_sensor(mounting)
    return np.asarray(_rotated(rotation, table[:, :3] - np.array(tare.wrench[:3]))[:, 2])


def slope(stamps_ns: Sequence[int], values: Array) -> float:
    """Change per second by a least-squares line; 0 for fewer than two. (0 s, 1), (1 s, 3) give 2."""
    if len(stamps_ns) < 2:
        return 0.0
    times = (np.array(stamps_ns, np.float64) - stamps_ns[0]) / NS_PER_S
    times -= times.mean()
    return float((times * (values - values.mean())).sum() / max(float((times**2).sum()), 1e-12))


def slope_noise(stamps_ns: Sequence[int], noise: float) -> float:
    """Standard deviation of `slope` due to white noise of the values."""
    if len(stamps_ns) < 2:
        return math.inf
    times = (np.array(stamps_ns, np.float64) - stamps_ns[0]) / NS_PER_S
    return noise / math.sqrt(max(float(((times - times.mean()) ** 2).sum()), 1e-12))


def mean_change(samples: Sequence[Sample], tare: Tare) -> float:
    """Difference of the mean force from the tare; infinite if a sample cannot be used."""
    if not all(sample.usable for sample in samples):
        return math.inf
    return length(wrenches(samples)[:, :3].mean(axis=0) - np.array(tare.wrench[:3]))


def mean_noise(tare: Tare, count: int) -> float:
    """Bound on the difference between the mean of `count` samples and the tare that noise can cause."""
    return NOISE_SIGMAS * length(np.array(tare.deviation[:3])) / math.sqrt(max(1, count))


def length(values: Array) -> float:
    """Length of a vector over the measured axes; NaN if none is measured. (3, NaN, 4) gives 5."""
    measured = values[~np.isnan(values)]
    return float(np.hypot.reduce(measured)) if len(measured) else math.nan
